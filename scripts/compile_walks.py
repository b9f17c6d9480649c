"""Compile the walks through slabs, which need no PyTorch, into the user's cache of kernels; or those of wave tracing.

    python scripts/compile_walks.py
    python scripts/compile_walks.py --waves

`make demo` and `make test` run it while packages are unpacked: a compiler and an unpacker keep two processors busy.
Blocks of the page that need a package still to be unpacked run again after the others, for a minute at most.
"""

import importlib
import re
import sys
import time
from pathlib import Path

import specklegen as sg

PAGE = Path(__file__).parents[1] / "docs" / "wavetracing.md"


def is_done(block: str) -> bool:
    """Run a block of Python; return False, after two seconds, where a package is missing."""
    try:
        exec(block, {"__name__": "block"})
    except ModuleNotFoundError:
        time.sleep(2)
        importlib.invalidate_caches()
        return False
    return True


def main() -> None:
    """Compute one short memory effect, or what a page on wave tracing computes; what is compiled stays on disk."""
    if "--waves" in sys.argv:
        blocks = re.findall(r"^```python\n(.*?)^```", PAGE.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
        for _ in range(30):
            blocks = [block for block in blocks if not is_done(block)]
        sys.exit(len(blocks))
    slab = sg.Slab(thickness=1000.0, mean_free_path=100.0, scatterer=sg.media.HenyeyGreenstein(g=0.9))
    sg.memory_effect(slab, wavelength=0.5, tilts=[0.0, 1e-5], paths=4000)


if __name__ == "__main__":
    main()
