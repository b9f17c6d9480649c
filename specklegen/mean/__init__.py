"""Averages over media: the mean (ballistic) field; reflected and transmitted light."""
