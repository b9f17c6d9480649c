"""What a process keeps between samples, thrown away: results of today's state, not of an earlier one."""

import functools
import gc


def forget():
    """Empty every memo of the package but those of the compiled kernels and of the libraries."""
    for each in gc.get_objects():
        if isinstance(each, functools._lru_cache_wrapper):
            module = getattr(each, "__module__", None) or ""
            if module.startswith("specklegen.") and not module.startswith(("specklegen.core.", "specklegen.kernels.")):
                each.cache_clear()
