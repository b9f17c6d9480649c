"""Stochastic FDTD in one dimension: mean fields of random layers, by brute force and from a single run.

`RandomLayer` describes the medium; `yee` marches media of it, `transfer_matrix` solves the same grid exactly
in frequency; `monte_carlo_mean` averages either over many media, `single_realization` gives the mean to
second order from one run [Tan13], with a judgement on its validity. `coherent_transmission` and
`equivalent_slab` tie the mean forward wave to a bulk scattering medium.
"""

from specklegen.fdtd.courant import courant_limit
from specklegen.fdtd.currents import SingleDelay, in_phase, out_of_phase, single_delay
from specklegen.fdtd.fresnel import slab_fresnel
from specklegen.fdtd.incidence import Incidence, Pulse, illuminate
from specklegen.fdtd.layers import Moments, RandomLayer, sample_moments
from specklegen.fdtd.mean_field import CoherentTransmission, EquivalentSlab, coherent_transmission, equivalent_slab
from specklegen.fdtd.monte_carlo import monte_carlo_mean
from specklegen.fdtd.scattered import MeanField, ScatteredField, Validity
from specklegen.fdtd.single_realization import single_realization
from specklegen.fdtd.transfer_matrix import transfer_matrix
from specklegen.fdtd.validity import phase_variance
from specklegen.fdtd.yee import yee

__all__ = [
    "CoherentTransmission", "EquivalentSlab", "Incidence", "MeanField", "Moments", "Pulse", "RandomLayer",
    "ScatteredField", "SingleDelay", "Validity", "coherent_transmission", "courant_limit", "equivalent_slab",
    "illuminate", "in_phase", "monte_carlo_mean", "out_of_phase", "phase_variance", "sample_moments", "single_delay",
    "single_realization", "slab_fresnel", "transfer_matrix", "yee",
]  # fmt: skip
