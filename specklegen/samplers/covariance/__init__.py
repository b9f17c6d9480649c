"""The covariance between lights and views, and fields drawn from it. Algorithms 1 and 3 of [Bar19]."""
