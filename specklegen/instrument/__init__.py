"""The laboratory: distances and pixels to directions, and the camera that counts photons."""
