"""Thin screens: the stationary sampler's drawing, with a correlation in closed form and an envelope that moves."""
