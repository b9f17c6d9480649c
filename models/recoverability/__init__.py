"""Whether a hidden object can be seen at all, before an image is rendered."""
