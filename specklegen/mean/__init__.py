"""The mean (ballistic) field of every geometry."""
