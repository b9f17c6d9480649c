"""Pictures of lit scenes: each pixel looks for its point of the scene, and each point is connected with the lamp.

A camera infinitely far away (orthographic) looks along the normal of a plane; its pixels are those of the plane. The
radiance of a matt surface of reflectance rho (Lambert) is

    L = rho E / pi,   E = sum over paths of |u|^2 |cos theta|

of all paths from the lamp to the point: straight, by mirrors, and past edges, as `coherent_rays` finds them. So no
light has to hit a pixel by chance (next-event estimation). Fringes between two paths are finer than a pixel and are
left out: powers add. Light from one matt surface to another is not there.

Source: S. Steinberg, M. Pharr, *Wave Tracing*, section on connections to emitters and sensors; J. T. Kajiya, *The
rendering equation*, SIGGRAPH 1986 (next-event estimation).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from specklegen.core.arguments import instance, whole_number
from specklegen.core.parallel import Threads
from specklegen.core.quantities import with_units
from specklegen.wavetracing.coherent_ray_sums import PathSearch
from specklegen.wavetracing.edges import WELD, normals, scene_size
from specklegen.wavetracing.emitters import PointEmitter
from specklegen.wavetracing.geometry import Geometry
from specklegen.wavetracing.plane import Plane


class Sights(NamedTuple):
    """Points of a scene that lines of sight meet.

    Attributes
    ----------
    met : bool[N]
        Lines of sight that meet something.
    points, normals : float64[M, 3]
        Where, and unit normals towards the viewer, of those.
    mesh : int32[M]
        The mesh met.
    """

    met: np.ndarray
    points: np.ndarray
    normals: np.ndarray
    mesh: np.ndarray


def sights(geometry: Geometry, starts: np.ndarray, sight: np.ndarray, threads: Threads = None) -> Sights:
    """Look from points float64[N, 3] along a unit vector ``sight`` float64[3]."""
    distance, number = geometry.ray(starts, sight, threads=threads)
    met = number >= 0
    row = np.zeros(int(geometry.number.max(initial=0)) + 1, np.int64)
    row[geometry.number] = np.arange(len(geometry))
    face = row[number[met]]
    normal = normals(geometry.vertices, geometry.faces)[face]
    normal = normal * np.where(normal @ sight > 0, -1.0, 1.0)[:, None]
    return Sights(met, starts[met] + distance[met][:, None] * sight, normal, geometry.mesh[face])


def raised(geometry: Geometry, found: Sights) -> np.ndarray:
    """Return the points seen, each taken a little off its surface, float64[M, 3]."""
    return found.points + 400 * WELD * scene_size(geometry.vertices) * found.normals


def cosines(geometry: Geometry, found: Sights, to_lamp: np.ndarray, threads: Threads = None) -> np.ndarray:
    """Return |cos| float64[M] of light that comes straight from points + ``to_lamp`` float64[M, 3]; 0 in shadow."""
    cosine = (found.normals * to_lamp).sum(axis=1) / np.linalg.norm(to_lamp, axis=1)
    lit = np.flatnonzero(cosine > 0)
    distance, _ = geometry.ray(raised(geometry, found)[lit], to_lamp[lit], threads=threads)
    out = np.zeros(len(cosine))
    out[lit] = np.where(distance < 1, 0.0, cosine[lit])
    return out


@with_units
def picture(
    geometry: Geometry,
    source: PointEmitter,
    plane: Plane,
    reflections: int = 0,
    diffractions: int = 0,
    *,
    samples: int = 2,
    floor_db: float = 60.0,
    threads: Threads = None,
) -> np.ndarray:
    """Return the radiance of matt surfaces as a camera infinitely far away sees them.

    Parameters
    ----------
    geometry
        The scene. Surfaces of :class:`Diffuse` are seen; others are black to the camera, but cast shadows, reflect
        light onto matt ones and diffract it.
    source
        The lamp.
    plane
        Pixels of the camera: it receives light that travels along the plane's normal, so the scene lies before it.
    reflections, diffractions
        Most mirrors and most edges on the way from the lamp to a surface, as of `coherent_rays`; by default light goes
        straight.
    samples
        Lines of sight along each side of a pixel.
    floor_db
        Paths past edges are left out once all that are left are together this many dB below those that were found.
    threads
        Threads, by default all cores that the process may run on; the result does not depend on them.

    Returns
    -------
    float64[h, w]
        Power per area and solid angle; rows y and columns x of the plane, from the smallest. May be the ``brightness``
        of an :class:`~specklegen.light.IncoherentObject`.

    Raises
    ------
    RuleError
        For arguments out of range, or a surface nearer to the lamp than 1 / k.

    Examples
    --------
    >>> from specklegen.wavetracing import Diffuse, Geometry, Plane, PointEmitter, perforated_screen, picture
    >>> paper = perforated_screen([[-5, -5], [5, -5], [5, 5], [-5, 5]], material=Diffuse(albedo=0.8))
    >>> lamp = PointEmitter(position=[0, 0, 9], wavelength=5e-4)
    >>> picture(Geometry([paper]), lamp, Plane(center=[0, 0, 10], shape=(4, 4), pitch=2.0)).round(4).tolist()[1]
    [0.0002, 0.0002, 0.0002, 0.0002]
    """
    instance("picture geometry", geometry, Geometry)
    instance("picture plane", plane, Plane)
    samples = whole_number("picture samples", samples, 1, 64)
    search = PathSearch("picture", geometry, source, reflections, diffractions, "material", floor_db)
    fine = plane.replace(shape=tuple(samples * n for n in plane.shape), pitch=plane.pitch / samples)
    found = sights(geometry, fine.points.reshape(-1, 3), -plane.axes[2], threads)
    if reflections or diffractions:
        flux = search.found(raised(geometry, found), threads, normals=found.normals)[1].mean(axis=1)
    else:
        search.check(found.points)
        away = source.position - found.points
        flux = source.power / (4 * np.pi) * cosines(geometry, found, away, threads) / np.square(away).sum(axis=1)
    matt = np.array([getattr(mesh.material, "albedo", 0.0) for mesh in geometry.meshes])
    image = np.zeros(len(found.met))
    image[found.met] = matt[found.mesh] * flux / np.pi
    rows, columns = plane.shape
    return image.reshape(rows, samples, columns, samples).mean(axis=(1, 3))
