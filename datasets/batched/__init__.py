"""Batches made on a device: pure functions of tensors from sample numbers to images."""
