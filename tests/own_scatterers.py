"""Scatterers of a user's own, defined again and again under one name, as in a notebook."""

import sys
from types import ModuleType

import specklegen as sg


def defined(source, **known):
    """The class ``Lobe`` as a cell of a notebook defines it; ``source`` is its amplitude, in cos and self.power."""
    cell = dict(known, sg=sg, __name__="notebook")
    exec(  # noqa: S102
        "class Lobe(sg.Scatterer):\n"
        "    power: float = 1.0\n"
        "    def shape(self, cos, dimensions=3):\n"
        f"        return {source}\n",
        cell,
    )
    sys.modules["notebook"] = notebook = ModuleType("notebook")  # so that pickles find the class
    notebook.Lobe = cell["Lobe"]  # type: ignore[attr-defined]
    return cell["Lobe"], cell


def forgotten():
    """Take the name out of the registry."""
    from specklegen.scene.scatterers.scatterer import _TYPES

    _TYPES.pop("Lobe", None)
