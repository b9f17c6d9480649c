"""Coherent objects behind thin screens: the object's field times that of one screen, exactly, or modes of a stack.

The field of one screen is stationary over its plane, with the spectrum f of its light; what it does to all plane waves
is one product. Of a stack, light is carried to the plane at which its pattern stands still under a tilt,
``pivot`` before the exit plane; what remains of K between the waves there is that of the fixed view, in modes.
"""

import numpy as np

from specklegen.samplers.coherent_media import CoherentImaging, straight_waves
from specklegen.samplers.sampler import MediaRequest
from specklegen.samplers.screens.correlation import profile, screen_correlation
from specklegen.scene.scene import Scene
from specklegen.scene.screens import ScreenStack
from specklegen.synthesis.coherent import ManyObjects, WaveGrid, radial, wave_grid, wave_modes
from specklegen.synthesis.correlations import Tabulated
from specklegen.synthesis.drawn_screens import DrawnScreens, drawn_screens
from specklegen.theory.phase_screens import lobes

_CIRCULAR = 1e-3  # share of the mirrored field that nobody sees
_CENTRED = 0.5  # pixels that a camera's middle may lie beside the axis, for mirror images to be drawn


def gaussian_scene(scene: Scene) -> tuple[ManyObjects, np.ndarray]:
    """Return what draws coherent objects behind a scene's screens as Gaussian speckle, and their amplitudes."""
    assert scene.thin is not None
    grid, amplitudes = wave_grid(scene.illumination, scene.wavelength, scene.grid)
    return behind_screens(scene.thin, scene.wavelength, grid), amplitudes


def behind_screens(stack: ScreenStack, wavelength: float, grid: WaveGrid) -> ManyObjects:
    """Prepare to draw the speckle of coherent objects behind a stack of screens."""
    terms, alone = lobes(stack, wavelength), len(stack.screens) == 1
    count, p = len(grid.sines), grid.distances()
    if not len(terms.shares):
        return ManyObjects(grid, np.ones((1, count, count)), 0.0)
    modes = np.ones((1, count, count))
    if not alone:
        modes = wave_modes(Tabulated([screen_correlation(stack, wavelength)]), grid)
    gain = float(np.sqrt(terms.density(np.zeros(1))[0] * grid.area))
    carried = modes * _carried(stack, wavelength, grid, terms.walk_shares)
    spectrum, mirrored = radial(lambda at: profile(terms, at), p), None
    if alone and np.abs(grid.center).max() <= _CENTRED * grid.pitch:
        even, odd = (radial(lambda at, n=n: profile(terms, at, terms.of_parity(n)), p) / np.sqrt(2) for n in (0, 1))
        if (np.abs(even - odd) > _CIRCULAR * (even + odd)).any():
            spectrum, mirrored = even + odd, (even - odd).astype(np.float32)
    return ManyObjects(grid, carried, gain, spectrum.astype(np.float32), mirrored)


def _carried(stack: ScreenStack, wavelength: float, grid: WaveGrid, walk_shares: np.ndarray) -> np.ndarray:
    """Phases complex128[M, M] of the way of each plane wave from the first screen to the pivot."""
    pivot = float(walk_shares @ stack.distances)
    square = np.square(grid.sines) + np.square(grid.sines)[:, None]
    cosines = np.sqrt(np.clip(1 - square, 0, None))
    return np.exp(-2j * np.pi / wavelength * (stack.distances[0] - pivot) * square / (1 + cosines))


def coherent_imagings(request: MediaRequest, *, drawn: bool = False) -> list[tuple[list[int], CoherentImaging]]:
    """Prepare media of a recipe, behind which coherent objects are seen."""
    waves, prepared = request.waves, []
    assert waves is not None
    for n, make in enumerate(request.media):
        stack = make().stack
        assert stack is not None
        wavelength = waves.grid.wavelength
        intensity = float(lobes(stack, wavelength).density(np.zeros(1))[0])
        depth, thickness = stack.optical_depth(wavelength), float(stack.distances[0])
        beside = waves.ballistic and not drawn
        straight = straight_waves(waves.grid, depth, thickness, intensity) if beside else None
        many: ManyObjects | DrawnScreens = behind_screens(stack, wavelength, waves.grid)
        if drawn:
            many = drawn_screens(stack, wavelength, waves.grid, waves.ballistic)
        prepared.append(
            ([n], CoherentImaging(waves.grid, waves.divisions, intensity, straight, many=many, shared=request.shared))
        )
    return prepared
