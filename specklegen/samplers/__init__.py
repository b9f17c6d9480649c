"""Samplers: each a folder with its own rule, cost and memory. They do not know each other."""
