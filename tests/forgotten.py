"""What a process keeps between samples, thrown away: results of today's state, not of an earlier one."""

import functools
import gc
import random
import sys


def forget():
    """Empty every memo of the package but those of the compiled kernels and of the libraries."""
    forget_some(0, 1.0)


def forget_some(seed, share):
    """Empty a share of the memos, drawn: what is kept in the others meets what is worked out anew."""
    drawn = random.Random(seed)  # noqa: S311
    memos = [each.cache_clear for each in _memos(len(sys.modules))]
    for clear in [*memos, *_generators()]:
        if share == 1 or drawn.random() < share:
            clear()


def _generators():
    """What forgets generators of samples and other results that are kept by their bytes, where there can be any."""
    kept = sys.modules.get("specklegen.core.most_recent")
    return [] if kept is None else [each.forget for each in kept.STORES.values()]


@functools.lru_cache(1)
def _memos(_modules):
    """Memos of as many modules as are loaded: to look through all objects takes half a second."""
    gc.unfreeze()  # what conftest.py has frozen is in no list
    # The type itself: isinstance() asks a weak reference's proxy for the class of an object that may be gone.
    found = [each for each in gc.get_objects() if type(each) is functools._lru_cache_wrapper and _own(each)]
    gc.freeze()
    return sorted(found, key=lambda each: (each.__module__, each.__qualname__))


def _own(memo):
    module = getattr(memo, "__module__", None) or ""
    return module.startswith("specklegen.") and not module.startswith(("specklegen.core.", "specklegen.kernels."))
