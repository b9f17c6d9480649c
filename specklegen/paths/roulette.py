"""Russian roulette of connections: faint ones are kept rarely, and count for more when they are.

A connection of contribution w is kept with probability min(1, w / threshold), its weight divided by that.
"""

import numpy as np

from specklegen.core.random_streams import Seed, Stream
from specklegen.paths.slab_optics import Optics, contributions
from specklegen.paths.slab_tracer import Proposal, trace
from specklegen.scene.media import Slab

PILOT_PATHS = 2000
KEEP_ALWAYS = 10.0  # a connection is always kept from ten times the mean contribution (physics.md 2)


def roulette_threshold(medium: Slab, proposal: Proposal, optics: Optics, tilt: np.ndarray, seed: Seed) -> float:
    """Contribution from which connections are always kept: ten times their mean in a pilot (physics.md 2)."""
    bank = trace(medium, proposal, seed, PILOT_PATHS, stream=Stream.PILOT, threads=1)
    if len(bank) == 0:
        return 0.0
    weights = [contributions(bank, optics, tilt, view) for view in proposal.probes]
    return KEEP_ALWAYS * float(np.max(weights, axis=0).mean())
