"""How the particles of a medium redistribute light, one family a file."""
