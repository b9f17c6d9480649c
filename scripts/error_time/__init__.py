"""Error against run time: scenes, methods, references, runs, and the tables that are made of them."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[2] / "tests"))  # right values: tests/references
