"""Closed forms: what Monte Carlo must reproduce."""
