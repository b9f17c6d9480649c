"""Scores, baselines and tables."""
