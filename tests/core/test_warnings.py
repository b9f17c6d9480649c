"""Where warnings point: at the line of the user, however many frames of the package and its decorators lie between."""

import warnings

import pytest

import specklegen as sg
from specklegen.core.errors import warn_user

SLAB = sg.Slab(thickness=0.4, mean_free_path=0.2, scatterer=sg.media.Isotropic(),
               motion=sg.media.Brownian(diffusion=1e-3))
LIGHT = sg.light.CollimatedBeams.tilts([0.0, 1e-4], width=1.0)
SCENE = sg.Scene(wavelength=0.5, medium=SLAB, illumination=LIGHT, sensor=sg.sensors.FarField.grid((1, 2), 1e-3))
VERBS = {
    "render": lambda: sg.render(SCENE, paths=100, sampler="paths"),
    "render_tiles": lambda: sg.results.render_tiles(SCENE, paths=100),
    "render_partially_coherent": lambda: sg.coherence.render_partially_coherent(SCENE, 1.0, paths=100, sampler="paths"),
    "transmission_matrix": lambda: sg.statistics.transmission_matrix(SCENE, paths=100),
    "covariance": lambda: sg.statistics.covariance(SCENE, paths=100),
    "covariance_blocks": lambda: sg.statistics.covariance_blocks(SCENE, rows=2, paths=100),
    "memory_effect": lambda: sg.memory_effect(SLAB, wavelength=0.5, tilts=[0.0, 1e-3], paths=100),
    "temporal_correlation": lambda: sg.statistics.temporal_correlation(SLAB, wavelength=0.5, lags=[0.0, 1.0],
                                                                       paths=100),
}


@pytest.mark.parametrize("verb", VERBS)
def test_the_doubts_of_a_verb_point_at_who_called_it(verb):
    """Scatterers closer together than a wavelength, and a beam as narrow."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        VERBS[verb]()
    doubts = [each for each in caught if each.category is sg.DoubtWarning]
    assert doubts
    assert {each.filename for each in doubts} == {__file__}
    assert {each.lineno for each in doubts} == {VERBS[verb].__code__.co_firstlineno}


def test_a_direct_call_points_at_itself():
    with pytest.warns(sg.DoubtWarning, match="doubt") as caught:
        warn_user("doubt")
    assert caught[0].filename == __file__
