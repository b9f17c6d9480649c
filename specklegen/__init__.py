"""Correlated speckle image stacks from bulk material parameters."""
