"""The count of code lines that `make lint` compares with the ceilings."""

import json
import runpy
from collections import Counter
from pathlib import Path

COUNT = runpy.run_path(str(Path(__file__).parents[1] / "scripts/count_code.py"))

PROGRAM = '''"""Docstring of
two lines."""

import math  # code

# a comment
class Circle:
    """Docstring."""

    radius = 1.0
    """Documents the field above."""
    name = """text
over two lines"""

    def area(self):
        return (
            math.pi * self.radius**2
        )
'''


def test_blank_lines_comments_and_docstrings_are_no_code():
    # import, class, radius, two lines of name, def, three lines of return
    assert COUNT["code_lines"](PROGRAM) == 9


def test_every_room_has_a_ceiling_and_no_room_without_files_has_one():
    folders = (*COUNT["LIBRARY"], *COUNT["SINGLE_ROOMS"])
    rooms = {COUNT["room_of"](file) for folder in folders for file in COUNT["python_files"](folder)}
    assert set(json.loads(COUNT["CEILINGS"].read_text())) == rooms


def test_rooms_above_their_ceiling_are_named():
    code = Counter({"specklegen/core": 11, "tests": 5, "models": 1})
    problems = COUNT["excess"](code, {"specklegen/core": 10, "tests": 5})
    assert problems == ["models has 1 code lines; its ceiling is not set",
                        "specklegen/core has 11 code lines; its ceiling is 10"]  # fmt: skip
