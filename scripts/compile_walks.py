"""Compile the walks through slabs, which need no PyTorch, into the user's cache of kernels.

    python scripts/compile_walks.py

``make demo`` runs it while packages are unpacked: a compiler and an unpacker keep two processors busy.
"""

import specklegen as sg


def main() -> None:
    """Compute one short memory effect; what it compiles stays on disk."""
    slab = sg.Slab(thickness=1000.0, mean_free_path=100.0, scatterer=sg.media.HenyeyGreenstein(g=0.9))
    sg.memory_effect(slab, wavelength=0.5, tilts=[0.0, 1e-5], paths=4000)


if __name__ == "__main__":
    main()
