"""Fields of a path bank at the sensor: the direct sum, and the NUFFT on regular far-field grids."""
