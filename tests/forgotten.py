"""What a process keeps between samples, thrown away: results of today's state, not of an earlier one."""

import functools
import gc
import sys


def forget():
    """Empty every memo of the package but those of the compiled kernels and of the libraries."""
    for each in _memos(len(sys.modules)):
        each.cache_clear()


@functools.lru_cache(1)
def _memos(_modules):
    """Memos of as many modules as are loaded: to look through all objects takes half a second."""
    return [each for each in gc.get_objects() if isinstance(each, functools._lru_cache_wrapper) and _own(each)]


def _own(memo):
    module = getattr(memo, "__module__", None) or ""
    return module.startswith("specklegen.") and not module.startswith(("specklegen.core.", "specklegen.kernels."))
