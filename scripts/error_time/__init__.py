"""Error against run time: scenes, methods, references, runs, and the tables that are made of them."""
