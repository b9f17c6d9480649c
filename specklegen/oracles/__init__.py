"""Slow, independent ground truth: literal transcriptions of the papers' algorithms, and the wave equation itself.

Nothing here imports the engine that it judges (an import-linter contract); only the values that describe
a medium are shared. Formulas are the textbook's, even where a better-conditioned form exists.
"""
