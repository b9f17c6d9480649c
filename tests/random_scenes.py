"""Hypothesis strategies for scenes: thin to thick, vacuum to dense, forward to backward, eight decades of wavelength.

Lengths other than the wavelength are drawn in wavelengths, so that all decades see the same scenes.
"""

import numpy as np
from hypothesis import assume
from hypothesis import strategies as st

import specklegen as sg


def powers(low: float, high: float) -> st.SearchStrategy[float]:
    """Numbers evenly spread over decades."""
    return st.floats(low, high).map(lambda x: 10.0**x)


wavelengths = powers(-4, 4)
albedos = st.one_of(st.sampled_from([0.0, 1e-12, 1.0]), st.floats(0, 1))
optical_depths = st.one_of(st.sampled_from([1e-9, 1.0, 50.0]), powers(-9, 1.6))
anisotropies = st.one_of(st.sampled_from([-0.99, 0.0, 0.9, 0.999]), st.floats(-0.99, 0.999))


@st.composite
def tables(draw) -> sg.Tabulated:
    inner = draw(st.lists(st.floats(1e-3, 3.0), max_size=4, unique=True))
    theta = [0.0, *sorted(inner), np.pi]
    parts = st.floats(-1, 1).map(lambda x: round(x, 3))
    s = [complex(draw(parts), draw(parts)) for _ in theta]
    return sg.Tabulated(theta=theta, amplitude=s if any(s) else np.ones(len(s)))


particles = st.one_of(st.just(sg.Isotropic()), anisotropies.map(lambda g: sg.HenyeyGreenstein(g=g)),
                      powers(-6, 4).map(lambda k: sg.VonMisesFisher(concentration=k)), tables())  # fmt: skip
mixtures = st.tuples(particles, particles, st.floats(0, 1)).map(
    lambda drawn: sg.Mixture(types=drawn[:2], fractions=(drawn[2], 1 - drawn[2]))
)
scatterers = st.one_of(particles, mixtures)


@st.composite
def slabs(draw, wavelength: float, kinds=scatterers) -> sg.Slab:
    free_path = wavelength * draw(powers(-1, 5))
    depth = draw(st.one_of(st.just(0.0), optical_depths))
    return sg.Slab(thickness=depth * free_path, mean_free_path=free_path, albedo=draw(albedos), scatterer=draw(kinds))


def _corners(draw, dimension: int, thickness: float) -> tuple[np.ndarray, np.ndarray]:
    """A box with sides from a thousandth to a thousand times its thickness, anywhere near the origin."""
    sides = [thickness * draw(powers(-3, 3)) for _ in range(dimension - 1)] + [thickness]
    lower = -np.array(sides) * [draw(st.floats(0, 1)) for _ in sides]
    return lower, lower + sides


@st.composite
def boxes(draw, wavelength: float, dimension: int) -> sg.Box:
    free_path = wavelength * draw(powers(-1, 4))
    lower, upper = _corners(draw, dimension, free_path * draw(optical_depths))
    return sg.Box(lower=lower, upper=upper, mean_free_path=free_path, albedo=draw(albedos), scatterer=draw(scatterers))


@st.composite
def voxel_grids(draw, wavelength: float, dimension: int) -> sg.VoxelGrid:
    thickness = wavelength * draw(powers(-1, 4))
    lower, upper = _corners(draw, dimension, thickness)
    shape = tuple(draw(st.integers(1, 3)) for _ in range(dimension))
    count = int(np.prod(shape))
    base = draw(powers(-6, 0)) / (upper - lower).max()
    # A voxel 1e6 times denser must absorb: with albedo 1 a path would scatter in it as often as it is deep.
    factors = draw(st.lists(st.sampled_from([0.0, 1.0, 1.0, 10.0, 1e6]), min_size=count, max_size=count))
    albedo = np.where(np.array(factors) > 1e3, 0.3, draw(albedos)).reshape(shape)
    kinds = draw(st.lists(scatterers, min_size=1, max_size=2))
    material = draw(st.lists(st.integers(0, len(kinds) - 1), min_size=count, max_size=count))
    return sg.VoxelGrid(lower=lower, upper=upper, extinction=base * np.reshape(factors, shape), albedo=albedo,
                        material=np.reshape(material, shape), scatterers=tuple(kinds))  # fmt: skip


@st.composite
def directions(draw, dimension: int, count: int, forward: bool = False) -> np.ndarray:
    """Unit vectors float64[count, d], some of them along axes, at grazing, or twice the same."""
    rows = []
    for _ in range(count):
        if draw(st.booleans()):
            vector = np.zeros(dimension)
            axis = dimension - 1 if forward else draw(st.integers(0, dimension - 1))
            vector[axis] = 1.0 if forward else draw(st.sampled_from([1.0, -1.0]))
        else:
            vector = np.array([draw(st.floats(-1, 1)) for _ in range(dimension)])
            vector[-1] = abs(vector[-1]) + 1e-3 if forward else vector[-1]
            vector = vector / np.linalg.norm(vector) if np.linalg.norm(vector) > 1e-6 else np.eye(dimension)[-1]
        rows.append(vector)
    if count > 1 and draw(st.booleans()):
        rows[1] = rows[0]
    return np.array(rows).reshape(count, dimension)


def _points(draw, medium, dimension: int, count: int, wavelength: float) -> np.ndarray:
    """Points inside, on the faces of, and around a medium."""
    if isinstance(medium, sg.Slab):
        height = medium.thickness or wavelength
        lower, upper = np.append([-height] * (dimension - 1), 0.0), np.full(dimension, height)
    else:
        lower, upper = medium.lower, medium.upper
    share = st.one_of(st.sampled_from([0.0, 0.5, 1.0]), st.floats(-1, 2))
    return np.array([[low + draw(share) * (high - low) for low, high in zip(lower, upper, strict=True)]
                     for _ in range(count)]).reshape(count, dimension)  # fmt: skip


@st.composite
def scenes(draw) -> sg.Scene:
    """Any valid scene of at most 3 lights and 4 views."""
    wavelength, dimension = draw(wavelengths), draw(st.sampled_from([2, 3]))
    family = draw(st.sampled_from([slabs, boxes, voxel_grids]))
    medium = draw(slabs(wavelength) if family is slabs else family(wavelength, dimension))
    near = draw(st.booleans())
    lights, views = draw(st.integers(0, 3)), draw(st.integers(0, 4))
    sources = [sg.CollimatedBeams, sg.PointSources]
    if near or family is not slabs:
        sources.append(sg.PlaneWaves)
    source = draw(st.sampled_from(sources))
    if source is sg.PointSources:
        light = sg.PointSources(points=_points(draw, medium, dimension, lights, wavelength))
    elif source is sg.PlaneWaves:
        light = sg.PlaneWaves(directions=draw(directions(dimension, lights)))
    else:
        light = sg.CollimatedBeams(directions=draw(directions(dimension, lights, forward=True)),
                                   width=wavelength * draw(powers(0, 4)),
                                   profile=draw(st.sampled_from(["square", "disc", "gaussian"])))  # fmt: skip
    sensor = (
        sg.NearField(points=_points(draw, medium, dimension, views, wavelength))
        if near
        else sg.FarField(directions=draw(directions(dimension, views)))
    )
    if near and source is sg.PointSources and lights and views:  # a sensor on a source is refused
        assume(np.linalg.norm(light.points[:, None] - sensor.points, axis=-1).min() > 0.1 * wavelength)
    return sg.Scene(wavelength=wavelength, medium=medium, illumination=light, sensor=sensor)


indices = st.one_of(st.sampled_from([1.0, 1.33, 1.5]), st.floats(0.5, 3.0))


@st.composite
def faced_scenes(draw) -> sg.Scene:
    """A slab between steps of the refractive index, at most 3 beams, and at most 4 far views that cross its faces."""
    wavelength = draw(wavelengths)
    faces = sg.Faces(inside=draw(indices), outside=draw(indices), wall=draw(st.one_of(st.none(), indices)))
    lights = draw(directions(3, draw(st.integers(0, 3)), forward=True))
    views = draw(directions(3, draw(st.integers(0, 4))))
    narrow = [0.99 * faces.largest_sine * rows[:, :2] for rows in (lights, views)]
    lights, views = (
        np.column_stack([xy, side * np.sqrt(1 - (xy**2).sum(axis=1))])
        for xy, side in zip(narrow, (1.0, draw(st.sampled_from([1.0, -1.0]))), strict=True)
    )
    return sg.Scene(
        wavelength=wavelength, medium=draw(slabs(wavelength)).replace(faces=faces),
        illumination=sg.CollimatedBeams(directions=lights, width=wavelength * draw(powers(0, 4)),
                                        profile=draw(st.sampled_from(["square", "disc", "gaussian"]))),
        sensor=sg.FarField(directions=views),
    )  # fmt: skip


@st.composite
def screen_media(draw, wavelength: float) -> sg.PhaseScreen | sg.GroundGlass | sg.ScreenStack:
    """Thin media: smooth to rough, one to four of them, touching or far apart, at rest or in motion. Four of the widest
    have an rms angle of .32, just what a stack may have."""

    def screen():
        kind = draw(st.integers(0, 2))
        if kind == 2:
            return sg.GroundGlass(angle=draw(powers(-4, -0.6)), rms_height=wavelength * draw(powers(0, 1)))
        length, angle = wavelength * draw(powers(0.1, 4)), draw(st.one_of(st.just(0.0), powers(-9, -0.8)))
        phase = min(angle * np.sqrt(2) * np.pi * length / wavelength, 300.0)  # sigma of this rms angle
        index = draw(indices) if kind else 1.0
        if index == 1:
            return sg.PhaseScreen(rms_phase=phase, correlation_length=length)
        height = phase * wavelength / (2 * np.pi * abs(index - 1))
        return sg.PhaseScreen(rms_height=height, index=index, correlation_length=length)

    screens = tuple(screen() for _ in range(draw(st.integers(1, 4))))
    if len(screens) == 1 and draw(st.booleans()):
        return screens[0]
    gap = st.one_of(st.just(0.0), powers(-3, 6)).map(lambda gap: gap * wavelength)
    move = st.one_of(st.just(0.0), st.floats(-100, 100)).map(lambda way: way * wavelength)
    return sg.ScreenStack(
        screens=screens, gaps=[draw(gap) for _ in screens[1:]], behind=draw(gap),
        velocities=draw(st.one_of(st.none(), st.just([(draw(move), draw(move)) for _ in screens]))),
    )  # fmt: skip


@st.composite
def screen_scenes(draw) -> sg.Scene:
    """At most 3 beams through thin media, seen on a small grid."""
    wavelength = draw(wavelengths)
    medium = draw(screen_media(wavelength))
    width = wavelength * draw(powers(0, 6))
    moving = isinstance(medium, sg.ScreenStack) and medium.velocities is not None
    lights = draw(st.integers(1, 3))
    step = draw(powers(-9, -1))
    return sg.Scene(
        wavelength=wavelength, medium=medium,
        illumination=sg.CollimatedBeams.tilts(step * np.arange(lights), width=width,
                                              times=np.arange(lights) if moving else None,
                                              profile=draw(st.sampled_from(["square", "disc", "gaussian"]))),
        sensor=sg.FarField.grid((draw(st.integers(1, 8)), 8), pitch=draw(powers(-9, -1.2))),
    )  # fmt: skip
