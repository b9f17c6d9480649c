"""Synthesis of fields and images from the memory-effect correlation: one tensor program, in batches, on any device."""
