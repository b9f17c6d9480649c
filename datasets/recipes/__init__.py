"""Recipes: what a data set is made of, one kind a file."""
