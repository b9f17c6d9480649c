"""A cache on disk of a test's own, with the kernels that this user has compiled."""

from pathlib import Path

from specklegen import disk_cache


def link_kernels(folder: Path) -> Path:
    """Return a cache folder whose kernels are those of this user."""
    kernels = disk_cache.folder_of("kernels")
    assert kernels is not None
    disk_cache._make(kernels)
    (folder / "kernels").symlink_to(kernels)
    return folder
