"""The way of a scene through the library, and circles of imports inside rooms, may only get shorter."""

import runpy
from pathlib import Path

COUNTER = runpy.run_path(str(Path(__file__).parents[1] / "scripts/count_calls.py"))


def test_a_render_passes_no_more_functions_than_it_did():
    """More than the script says: call fewer layers, or work out once what is asked again. Fewer: lower the number."""
    calls = COUNTER["calls_of"](COUNTER["jobs"]()["render(scene)"])
    named = [function for function in calls if COUNTER["is_named"](function)]
    assert len(named) <= COUNTER["MOST_NAMED"], "\n".join(map(str, sorted(named)))
    assert len({file for file, *_ in named}) <= COUNTER["MOST_FILES"]


def test_no_more_files_import_each_other_in_circles():
    assert len(COUNTER["circles"]()) <= COUNTER["MOST_CIRCLES"], COUNTER["circles"]()


def test_the_count_knows_named_functions_from_parts_of_them():
    """Properties, comprehensions and methods with two underscores are parts of what asks them."""
    file = "specklegen/scene/scene.py"
    lines = (COUNTER["ROOT"] / file).read_text().splitlines()
    place = next(n for n, line in enumerate(lines) if "def dimension(self)" in line)
    assert not COUNTER["is_named"]((file, place, "Scene.dimension"))  # the line of its decorator
    function = next(n for n, line in enumerate(lines) if line.startswith("def require_range"))
    assert COUNTER["is_named"]((file, function + 1, "require_range"))
    assert not COUNTER["is_named"]((file, function + 1, "require_range.<locals>.<listcomp>"))
    assert not COUNTER["is_named"]((file, function + 1, "Scene.__init__"))
