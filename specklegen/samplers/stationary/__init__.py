"""The stationary sampler: correlated stacks and images of hidden objects by FFT, for wide slabs."""
