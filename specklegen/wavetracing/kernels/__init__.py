"""Numba kernels of wave tracing alone; the compiler and what all kernels share are in `specklegen.kernels`."""
