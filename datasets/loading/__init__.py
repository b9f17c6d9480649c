"""Loading: streams, caches and their loaders for training."""
