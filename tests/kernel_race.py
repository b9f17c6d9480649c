"""Work of one process in the test of the kernel cache; a module of its own, so that spawned processes find it."""

import hashlib
import os

from specklegen.memory_effects import cache
from specklegen.memory_effects.atlas import correlation_for
from specklegen.scene.media import Slab
from specklegen.scene.scatterers import HenyeyGreenstein


def use_and_delete(folder: str) -> list[str]:
    os.environ["SPECKLEGEN_CACHE"] = folder
    medium, seen = Slab(thickness=1.0, mean_free_path=5.0, scatterer=HenyeyGreenstein(g=0.5)), []
    for _ in range(15):
        kernel = correlation_for(medium, paths=2000)
        seen.append(f"{kernel.source} {hashlib.sha256(kernel.weights.tobytes()).hexdigest()}")
        for file in cache.folder().glob("*.kernel"):
            file.unlink(missing_ok=True)
    return seen
