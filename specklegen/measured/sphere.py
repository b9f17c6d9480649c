"""Readings of integrating spheres from the files of the inverse adding-doubling program (.rxt), and what they mean.

A file says what the sample lies between, how large the spheres and their ports are, how their walls reflect, and lists
readings: reflection over that of a standard times its reflectance, transmission over that of no sample, and collimated
transmission. Of one sphere the reading is not yet the sample's reflectance: the sample replaces the standard in the
port, and so changes how bright the sphere is.

Correction: light that leaves a wall or a sample lands anywhere on the sphere in proportion to area, light of the
sample not on the detector, which a baffle hides from it. With the shares a of the area and the reflectances r of walls
(w) and in the sample's port (s); the landings W, S on the wall and in the port, per unit of light that the sample sends
out, obey

    W = a_w b + r_w a_w W + r_s a_w b S        S = a_s b + r_w a_s W + r_s a_s b S        b = 1 / (1 - a_d)

and the detector has r_w a_d W (Goebel, *Appl. Opt.* 6, 125 (1967); Pickering et al., *Appl. Opt.* 32, 399 (1993)). The
reading over the corrected value is W at the sample's reflectance over W at the reference's.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np

from specklegen.core.arguments import flag
from specklegen.core.display.plot import Pictured, draw_curve
from specklegen.core.display.repr import summary
from specklegen.core.errors import counted, reject
from specklegen.core.quantities import takes_units
from specklegen.core.units import MILLIMETRES
from specklegen.measured.curve import OWN_FILE, text_of

_HEAD = (
    "sample_index", "slide_index", "thickness", "slide_thickness", "beam_diameter", "standard",
)  # fmt: skip
_PARTS = ("diameter", "sample_port", "third_port", "detector_port", "wall")
_LETTERS = {
    "r": "reflection", "t": "transmission", "u": "collimated", "w": "wall", "W": "transmission_wall",
    "R": "standard", "T": "transmission_standard", "L": "wavelength", "n": "sample_index",
}  # fmt: skip
_SHARES = tuple(_LETTERS.values())[:7]
"""Columns in the order of a file that counts them; the program tells small letters from capitals."""
_ENOUGH = 1e-14
_STEPS = 200


@takes_units
class Sphere(NamedTuple):
    """A sphere: diameters of it and of its ports, in millimetres, and the reflectance of its wall.

    The third port lets light in, or out, or closes the sphere.

    Parameters
    ----------
    diameter
        Of the sphere, mm.
    sample_port, third_port, detector_port
        Diameters of the ports, mm.
    wall
        Reflectance of the wall for diffuse light, 0 to 1; a number, or one for each sample.
    """

    diameter: Annotated[float, MILLIMETRES]
    sample_port: Annotated[float, MILLIMETRES]
    third_port: Annotated[float, MILLIMETRES]
    detector_port: Annotated[float, MILLIMETRES]
    wall: Any

    def landings(self, reflectance: np.ndarray | float, *, open_port: bool) -> np.ndarray:
        """Landings on the wall, per unit of light that a sample of that reflectance sends into the sphere.

        Parameters
        ----------
        reflectance
            Of what is in the sample's port, for diffuse light.
        open_port
            Whether light leaves by the third port; else it is closed by wall.
        """
        ports = np.square(np.array([self.sample_port, self.third_port, self.detector_port]) / self.diameter) / 4
        a_s, a_e, a_d = ports
        a_w = 1 - a_s - a_d - (a_e if open_port else 0.0)
        b = 1 / (1 - a_d)
        r = np.asarray(reflectance, np.float64)
        determinant = (1 - self.wall * a_w) * (1 - r * a_s * b) - self.wall * a_s * r * a_w * b
        return np.asarray(a_w * b / determinant)


class Shares(NamedTuple):
    """Shares of the incident light, float64[n] each: reflected, transmitted, and straight on; None without readings."""

    reflectance: np.ndarray
    transmittance: np.ndarray | None
    collimated: np.ndarray | None


@takes_units
@dataclass(frozen=True, eq=False, repr=False)
class SphereReadings(Pictured):
    """Readings of an integrating sphere for samples of one geometry.

    Attributes
    ----------
    sample_index, slide_index : float
        Refractive indices of the sample and of the glass on both its faces.
    thickness, slide_thickness, beam_diameter : float
        In millimetres; a slide of 0 is none.
    standard : float
        Reflectance of the standard.
    spheres : int
        Spheres at a time: 0 for readings that were corrected before, 1, or 2.
    reflection_sphere, transmission_sphere : Sphere or None
    columns : dict of str to ndarray
        Raw readings float64[n] by name: "reflection", and perhaps "transmission", "collimated", "wavelength"
        (nanometres), "sample_index"; and what a sample has in the place of a number of the head: "wall" (of both
        spheres), "transmission_wall", "standard", "transmission_standard" (not used: readings are over it already).
    dual_beam : bool
        Whether a second beam measured the brightness of the sphere with the sample in it.
    file : str
    doubts : tuple of str

    Examples
    --------
    >>> import numpy as np
    >>> from specklegen.measured import Sphere, SphereReadings
    >>> sphere = Sphere(diameter=200.0, sample_port=20.0, third_port=20.0, detector_port=5.0, wall=0.97)
    >>> raw = {"reflection": np.array([0.4])}
    >>> read = SphereReadings(1.33, 1.5, 1.0, 1.0, 2.0, 0.99, 1, sphere, sphere, raw, False, "")
    >>> read.corrected().reflectance.round(3)  # a dark sample leaves the sphere darker than the standard did
    array([0.418])
    """

    sample_index: float
    slide_index: float
    thickness: Annotated[float, MILLIMETRES]
    slide_thickness: Annotated[float, MILLIMETRES]
    beam_diameter: Annotated[float, MILLIMETRES]
    standard: float
    spheres: int
    reflection_sphere: Sphere | None
    transmission_sphere: Sphere | None
    columns: Mapping[str, np.ndarray]
    dual_beam: bool
    file: str
    doubts: tuple[str, ...] = ()

    def corrected(self) -> Shares:
        """Shares of the light, with the sample's own effect on the sphere taken off.

        Transmission is over that of no sample, its port open; the third port of that sphere is taken as closed. The
        sample's reflectance for diffuse light is taken for its reflectance: 0.1 more or less of it changes a share by
        ``0.1 a_s / (1 - r_w)``, relative, which :meth:`explain` states. Raise a `RuleError` of two spheres at a time,
        which exchange light through the sample.
        """
        if self.spheres > 1:
            reject("SphereReadings.spheres", "0 or 1", self.spheres, "Two spheres exchange light through the sample.")
        raw = self.columns["reflection"]
        through, straight = self.columns.get("transmission"), self.columns.get("collimated")
        if self.spheres == 0 or self.dual_beam or self.reflection_sphere is None or self.transmission_sphere is None:
            return Shares(raw, through, straight)
        wall = self.columns.get("wall")
        front, behind = (
            sphere if own is None else sphere._replace(wall=own)
            for sphere, own in (
                (self.reflection_sphere, wall),
                (self.transmission_sphere, self.columns.get("transmission_wall", wall)),
            )
        )
        reference = front.landings(self.columns.get("standard", self.standard), open_port=True)
        share = raw
        for _ in range(_STEPS):
            old, share = share, raw * reference / front.landings(share.clip(0, 1), open_port=True)
            if np.abs(share - old).max() < _ENOUGH:
                break
        if through is not None:
            through = through * behind.landings(0.0, open_port=False) / behind.landings(share, open_port=False)
        return Shares(share, through, straight)

    def explain(self) -> str:
        """Say what was read, and how large the correction is, a line each."""
        return "\n".join(f"{name}: {value}" for name, value in self.facts().items())

    def __repr__(self) -> str:
        return summary(self, **self.columns)

    def _facts(self) -> Mapping[str, object]:
        glass = f", glass of {self.slide_index:g} on its faces" if self.slide_thickness else ", bare"
        facts: dict[str, object] = {
            "file": self.file, "sample": f"{self.thickness:g} mm of index {self.sample_index:g}{glass}",
            "readings": f"{len(self.columns['reflection'])} of {', '.join(self.columns)}",
        }  # fmt: skip
        if self.spheres == 1 and not self.dual_beam:
            moved = self.corrected().reflectance / self.columns["reflection"] - 1
            doubt = 0.05 * self._per_reflectance()
            facts["correction"] = f"{100 * moved.min():.2g} to {100 * moved.max():.2g} % of reflectance"
            facts["of its own error"] = f"{100 * doubt:.2g} % for a diffuse reflectance changed by 0.05"
        else:
            facts["correction"] = "none"
        return facts | {"doubts": self.doubts}

    def _per_reflectance(self) -> float:
        """Relative change of the sphere's brightness with the reflectance in its port."""
        assert self.reflection_sphere is not None
        ends = self.reflection_sphere.landings(np.array([0.0, 1.0]), open_port=True)
        return float(np.log(ends[1] / ends[0]))

    def _draw(self, axes: Any, label: str | None = None) -> None:
        at = self.columns.get("wavelength", np.arange(len(self.columns["reflection"])))
        for name, values in zip(Shares._fields, self.corrected(), strict=True):
            if values is not None:
                draw_curve(axes, at, values, label=name)
        axes.set(xlabel="wavelength, nm" if "wavelength" in self.columns else "sample", ylabel="share", ylim=(0, 1))


def read_sphere(path: str | Path, *, dual_beam: bool = False) -> SphereReadings:
    r"""Read the readings of an integrating sphere from a file of the inverse adding-doubling program.

    A line "IAD1"; then, a number a line and # before what is to be passed over: index of the sample, of the slides,
    thickness of both and diameter of the beam in millimetres, reflectance of the standard, number of spheres; diameter,
    three ports and wall of the reflection sphere and of that for transmission; the number of readings a sample, or a
    line of letters. Then a sample a line, in the order of the letters, or of the first of them as many as counted:
    r, t, u, the readings; w, the walls; W, that of the transmission sphere; R, T, the standards. Letters alone name L,
    the wavelength, which may stand before counted readings too, and n, the sample's index.

    Parameters
    ----------
    path
        The file.
    dual_beam
        Whether the spectrometer had a second beam, which measures the sphere with the sample in it; files do not say.

    Examples
    --------
    >>> import tempfile
    >>> from specklegen.measured import read_sphere
    >>> head = [1.33, 1.5, 1.0, 1.0, 2.0, 0.99, 1, *[200.0, 20.0, 20.0, 5.0, 0.97] * 2]
    >>> with tempfile.NamedTemporaryFile("w", suffix=".rxt") as file:
    ...     _ = file.write("IAD1\n" + "\n".join(map(str, head)) + "\nr t u\n.31 .40 .05\n")
    ...     file.flush()
    ...     read = read_sphere(file.name)
    >>> read, read.corrected().transmittance.round(3)
    (SphereReadings(1 sample, reflection, transmission, collimated), array([0.39]))
    """
    flag("read_sphere dual_beam", dual_beam)
    lines = [
        (number, re.split(r"[\s,]+", text))
        for number, line in enumerate(text_of("read_sphere path", path).splitlines(), 1)
        if (text := line.partition("#")[0].strip())
    ]
    if not lines or lines[0][1] != ["IAD1"]:
        header = " ".join(lines[0][1]) if lines else "nothing"
        reject(f"read_sphere {path}, line {lines[0][0] if lines else 1},", '"IAD1"', header, "Is it an .rxt file?")
    owner = f"read_sphere {path}, line "
    numbers: list[float] = []
    where: list[int] = []
    rest = 1
    while rest < len(lines) and len(numbers) < 18:
        at, cells = lines[rest]
        if len(cells) > 1 or _number(cells[0]) is None:
            break
        numbers.append(_finite(f"{owner}{at},", cells[0]))
        where.append(at)
        rest += 1
    if len(numbers) > 8 and len(numbers) < 17 and numbers[6] == 0:  # no spheres; the readings follow
        rest -= len(numbers) - 8
        numbers = numbers[:8]
    if len(numbers) < 7 or (numbers[6] > 0 and len(numbers) < 17) or 8 < len(numbers) < 17:
        at, cells = lines[min(rest, len(lines) - 1)]
        reject(f"{owner}{at},", "a number of the header: 7, and 10 of the spheres", " ".join(cells),
               f"{len(numbers)} numbers precede it.")  # fmt: skip
    _check_head(owner, numbers, where)
    spheres = [Sphere(*numbers[at : at + 5]) for at in (7, 12)] if len(numbers) >= 17 else [None, None]
    names, rest = _names(owner, lines, rest, numbers)
    table = _table(owner, lines[rest:], names)
    columns = dict(zip(names, table.T, strict=True))
    total = columns["reflection"] + columns.get("transmission", 0.0)
    doubts = [f"sample {int(total.argmax()) + 1} reflects and transmits {total.max():.3g} "
              "of the light"] if total.max() > 1 else []
    sample, slide, thickness, glass, beam, standard, number = numbers[:7]
    return SphereReadings(sample, slide, thickness, glass, beam, standard, int(number), spheres[0], spheres[1], columns,
                          dual_beam, str(path), tuple(doubts))  # fmt: skip


def _check_head(owner: str, numbers: list[float], where: list[int]) -> None:
    rules = [(0.1, 10.0), (0.1, 10.0), (0.0, 1e6), (0.0, 1e6), (0.0, 1e6), (0.0, 1.0), (0, 2)]
    rules += [*[(0.0, 1e6)] * 4, (0.0, 1.0)] * 2
    names = [*_HEAD, "spheres", *(f"{name} of a sphere" for name in (*_PARTS, *_PARTS))]
    for number, line, name, (low, high) in zip(numbers, where, names, rules, strict=False):
        if not low <= number <= high or (name == "spheres" and number % 1):
            reject(f"{owner}{line}, {name.replace('_', ' ')}", f"from {low:g} to {high:g}", number)
        if name in ("thickness", "standard", "diameter of a sphere") and not number > 0:
            reject(f"{owner}{line}, {name.replace('_', ' ')}", "greater than 0", number)
    for start in (7, 12):
        if len(numbers) >= 17:
            whole, *ports = numbers[start : start + 4]
            if sum(port**2 for port in ports) >= 2 * whole**2:
                rule = f"of a sphere larger than its ports of {', '.join(f'{port:g}' for port in ports)}"
                reject(f"{owner}{where[start]}, diameter", rule, whole, "All are in millimetres.")


def _names(
    owner: str, lines: list[tuple[int, list[str]]], rest: int, numbers: list[float]
) -> tuple[tuple[str, ...], int]:
    """Names of the columns, and the line where they begin."""
    if rest == len(lines):
        reject(f"{owner}{lines[-1][0]},", "followed by readings", "the end of the file")
    number, cells = lines[rest]
    if any(_number(cell) is None for cell in cells):
        unknown = [cell for cell in cells if cell not in _LETTERS]
        if unknown:
            reject(f"{owner}{number},", f"names of columns among {', '.join(_LETTERS)}", unknown[0])
        names = tuple(_LETTERS[cell] for cell in cells)
        if len(set(names)) < len(names) or "reflection" not in names:
            reject(f"{owner}{number},", "names of different columns, r among them", " ".join(cells),
                   "Small letters are readings, the capitals R and T standards.")  # fmt: skip
        return names, rest + 1
    readings = numbers[-1] if len(numbers) in (8, 18) else len(cells)
    if readings not in range(1, 8):
        reject(f"{owner}{number},", "1 to 7 numbers for each sample, or a line with the names of columns", readings)
    names = _SHARES[: int(readings)]
    return (("wavelength", *names) if len(cells) == readings + 1 else names), rest


def _table(owner: str, lines: list[tuple[int, list[str]]], names: tuple[str, ...]) -> np.ndarray:
    """Readings, float64[samples, columns]."""
    rows = []
    for number, cells in lines:
        if len(cells) != len(names):
            rule = f"{counted(len(names), 'number')}: {', '.join(names)}"
            reject(f"{owner}{number},", rule, " ".join(cells), OWN_FILE)
        row = [_finite(f"{owner}{number},", cell) for cell in cells]
        for name, value in zip(names, row, strict=True):
            if name in _SHARES and not 0 <= value <= 1:
                reject(f"{owner}{number}, {name}", "a share of the light, from 0 to 1", value)
        rows.append(row)
    if not rows:
        reject(f"{owner.removesuffix(', line ')} readings", "at least one", "none")
    return np.array(rows)


def _number(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None


def _finite(where: str, text: str) -> float:
    value = _number(text)
    if value is None or not np.isfinite(value):
        reject(where, "a finite number", text, OWN_FILE)
    return value
