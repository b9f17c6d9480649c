"""Feasibility: can a hidden object be seen at all, before an image is rendered."""
