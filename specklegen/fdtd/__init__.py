"""Stochastic FDTD in one dimension: mean fields of random layers, by brute force and from a single run.

`RandomLayer` describes the medium; `yee` marches media of it, `transfer_matrix` solves the same grid exactly
in frequency; `monte_carlo_mean` averages either over many media, `single_realization` gives the mean to
second order from one run [Tan13], with a judgement on its validity. `coherent_transmission` and
`equivalent_slab` tie the mean forward wave to a bulk scattering medium. Public names stand in ``__init__.pyi`` and
load when they are first used: recipes need the layer alone.
"""

from specklegen.core.extras import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
