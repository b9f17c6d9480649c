"""The parts of a recipe: material, light, tilts, viewing geometry, and the distributions they are drawn from."""
