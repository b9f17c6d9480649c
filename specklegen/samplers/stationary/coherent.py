"""Coherent objects of recipes behind slabs: light that has walked where media are new, else modes between waves."""

from functools import partial

import numpy as np

from specklegen.core.lazy import torch
from specklegen.core.parallel import one_torch_thread
from specklegen.samplers.coherent_media import CoherentImaging, straight_waves
from specklegen.samplers.sampler import MediaRequest
from specklegen.scene.window import Window
from specklegen.synthesis.coherent import ManyObjects, radial, wave_modes
from specklegen.synthesis.correlations import Correlations


def coherent_imagings(request: MediaRequest) -> list[tuple[list[int], CoherentImaging]]:
    """Prepare media of a recipe, behind which coherent objects are seen."""
    waves, prepared = request.waves, []
    assert waves is not None
    grid = waves.grid
    for n, make in enumerate(request.media):
        medium, known = make(), request.correlations.at([n])
        area = Window(request.sight.profile, float(request.sight.width[n])).area
        intensity = float(request.units[n]) / area
        straight = None
        if waves.ballistic:
            straight = straight_waves(grid, medium.optical_depth, medium.thickness, intensity)  # type: ignore[union-attr, arg-type]
        with one_torch_thread():
            if request.shared:
                modes = wave_modes(known, grid, request.tolerance, request.sight.device)
                many = ManyObjects(grid, modes, float(np.sqrt(intensity * grid.area)))
                own = CoherentImaging(grid, waves.divisions, intensity, straight, many=many, shared=True)
            else:
                walk = radial(partial(_on_host, known, request.sight.device), grid.lateral)
                own = CoherentImaging(grid, waves.divisions, intensity, straight, walk=walk)
        prepared.append(([n], own))
    return prepared


def _on_host(correlations: Correlations, device: "torch.device", q: np.ndarray) -> np.ndarray:
    """Return K float64[n] at wavevectors float64[n], of one medium that is known on some device."""
    return correlations(torch.from_numpy(q)[None].to(device))[0].cpu().numpy()
