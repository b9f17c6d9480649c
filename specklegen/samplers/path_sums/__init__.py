"""Path sums: the field of traced paths, by NUFFT or summed directly. Algorithms 2 and 4 of [Bar19]."""
