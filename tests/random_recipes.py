"""Hypothesis strategies for recipes: every packaged one and two of volumes, with fields changed, gently or wrongly."""

import copy

from hypothesis import strategies as st

from specklegen.datasets import recipe_names
from specklegen.datasets.recipes.recipe_files import recipe_table

BOXES = {"name": "boxes", "kind": "volume-stack", "outline": {"width": 10.0, "voxels": [2, 2, 2], "contrast": 0.5},
         "material": {"wavelength": 0.5, "thickness": 10.0, "optical_depth": 2.0, "g": 0.5}, "window": {"width": 8.0},
         "camera": {"shape": [6, 6], "distance": 20.0}, "tilts": {"count": 2, "step": 0.01}}  # fmt: skip
LAMPS = {"name": "lamps", "kind": "volume-object", "outline": {"width": 10.0}, "window": {"width": 8.0},
         "material": {"wavelength": 0.5, "thickness": 10.0, "optical_depth": 2.0, "g": 0.5},
         "camera": {"shape": [6, 6]}, "objects": {"type": "Glyphs", "shape": [5, 4]},
         "field": {"pitch": 0.02}}  # fmt: skip
CHOICES = {
    "profile": ["square", "disc", "gaussian"], "kernel": ["atlas", "estimate"], "faces": ["air", "matched"],
    "type": ["Bars", "Points", "Strokes", "Polygons", "Blobs", "Glyphs", "Digits", "GroundGlass", "PhaseScreen"],
}  # fmt: skip
ADDED = [("light", {"bandwidth": 1e-4}), ("light", {"bandwidth": 1e-3, "spectrum": "flat"}),
         ("light", {"polarised": False}), ("exposure", {"photons": 1000.0, "full_well": 1e4, "bit_depth": 8}),
         ("exposure", {"photons": 0.1}), ("media_group", 2), ("media", 3), ("media", "new"), ("sampler", "paths"),
         ("sampler", "stationary"), ("mode_tolerance", 0.1), ("coherence_length", float("inf")), ("distance", 1e4),
         ("objects", {"type": "Points"})]  # fmt: skip
WRONG = [0, -1, float("nan"), float("inf"), 1e300, 1e-300, 10**30, "x", "", None, True, [], {}, {"uniform": [2, 1]}]


def _places(table: dict, above: tuple = ()) -> list[tuple]:
    """Keys of everything in a table that is none itself."""
    found: list[tuple] = []
    for key, value in table.items():
        found += _places(value, (*above, key)) if isinstance(value, dict) else [(*above, key)]
    return [place for place in found if place[0] not in ("name", "description", "kind", "samples")]


def _gentle(draw, key: str, value):
    """Another value that may be right."""
    if isinstance(value, list):
        return [_gentle(draw, key, each) if isinstance(each, int | float) else each for each in value]
    if isinstance(value, bool):
        return not value
    if isinstance(value, str):
        return draw(st.sampled_from(CHOICES.get(key, [value])))
    if isinstance(value, int):
        return draw(st.sampled_from([1, 2, 3, 5, 2 * value, max(1, value // 2)]))
    if key in ("g", "albedo"):
        return draw(st.floats(0.01, 0.99))
    some = [value * 10 ** draw(st.floats(-1.5, 1.5)) for _ in range(2)] if isinstance(value, float) else [value] * 2
    kind = draw(st.sampled_from(["number", "number", "number", "uniform", "choice"]))
    return some[0] if kind == "number" else {kind: sorted(some)}


@st.composite
def recipe_tables(draw) -> dict:
    """A recipe as a table, of few paths and pixels; it need not be right."""
    name = draw(st.sampled_from([*recipe_names(), BOXES, LAMPS]))
    table = copy.deepcopy(name if isinstance(name, dict) else recipe_table(name))
    if "screens" not in table["material"]:
        table["material"]["kernel_paths"] = 1000
    if isinstance(name, str):
        (table["lab"] if "lab" in table else table["camera"])["pixels" if "lab" in table else "shape"] = [32, 32]
    if "pixels" in table.get("field", {}):
        table["field"]["pixels"] = draw(st.floats(3, 30))
    for _ in range(draw(st.integers(1, 3))):
        if draw(st.integers(0, 3)) == 0:
            key, value = copy.deepcopy(draw(st.sampled_from(ADDED)))
            table[key] = table.get(key, {}) | value if isinstance(value, dict) else value
            continue
        *way, key = draw(st.sampled_from(_places(table)))
        inner = table
        for each in way:
            inner = inner[each]
        wrong = draw(st.integers(0, 7)) == 0
        inner[key] = copy.deepcopy(draw(st.sampled_from(WRONG))) if wrong else _gentle(draw, key, inner[key])
    return table
