"""From the memory-effect correlation to fields and images: one tensor program, in batches, on any device."""
