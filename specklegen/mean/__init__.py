"""What an average over media leaves: the mean (ballistic) field; the light that is reflected and transmitted."""
