"""Your material from your own measurements: predictions by the atlas, least squares, intervals, and what to measure."""
