"""Fits of your material to your measurements: predictions by lookup table, least squares, intervals, advice."""
