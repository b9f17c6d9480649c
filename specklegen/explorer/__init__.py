"""The explorer: sliders for a slab, an object and a camera, and what comes of them, in a browser."""
