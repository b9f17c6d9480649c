"""Error against run time: scenes, methods, references, runs, and the page that is written from them."""
