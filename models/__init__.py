"""Reconstruction: phase retrieval, networks, and their evaluation."""
