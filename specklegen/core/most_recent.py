"""Results that are cached between calls: those asked for last, up to a number of bytes."""

from collections import OrderedDict
from collections.abc import Callable, Hashable
from itertools import count
from threading import RLock
from typing import Any, Generic, TypeVar
from weakref import WeakValueDictionary

from specklegen.core.memory import array_bytes

Key = TypeVar("Key", bound=Hashable)
Result = TypeVar("Result")

STORES: "WeakValueDictionary[int, MostRecent[Any, Any]]" = WeakValueDictionary()
"""All of this process, in the order in which they were made."""
_NUMBER = count()


class MostRecent(Generic[Key, Result]):
    """Results of pure functions of a key, the last of them up to a number of bytes.

    The last one stays, however large it is, until :meth:`trim`. What it holds may grow meanwhile: all are weighed when
    another wants a place. Any number of threads may ask.

    Parameters
    ----------
    most_bytes
        Bytes of all arrays of all results.
    most
        Results, for what is around the arrays takes memory too.
    held
        What of a result is weighed; by default all of it.

    Examples
    --------
    >>> import numpy as np
    >>> from specklegen.core.most_recent import MostRecent
    >>> results = MostRecent(2000)
    >>> [results.get(n, lambda: np.zeros(100)).nbytes for n in range(5)]
    [800, 800, 800, 800, 800]
    >>> len(results)
    2
    """

    def __init__(self, most_bytes: int, most: int = 64, held: Callable[[Result], object] = lambda whole: whole) -> None:
        self._most_bytes, self._most, self._held, self._lock = most_bytes, most, held, RLock()
        self._results: OrderedDict[Key, Result] = OrderedDict()
        STORES[next(_NUMBER)] = self

    def __len__(self) -> int:
        return len(self._results)

    def get(self, key: Key, make: Callable[[], Result]) -> Result:
        """Return the result of a key, made now if it is not there."""
        with self._lock:
            if key in self._results:
                self._results.move_to_end(key)
                return self._results[key]
        result = make()
        with self._lock:
            result = self._results.setdefault(key, result)  # another thread may have been as quick
            self._results.move_to_end(key)
            self.trim(least=1)
        return result

    def trim(self, least: int = 0) -> None:
        """Weigh them now, and let the oldest go while they are too large; the last ``least`` stay."""
        with self._lock:
            sizes = {key: array_bytes(self._held(result)) for key, result in self._results.items()}
            while len(sizes) > least and (len(sizes) > self._most or sum(sizes.values()) > self._most_bytes):
                oldest, _ = self._results.popitem(last=False)
                del sizes[oldest]

    def forget(self) -> None:
        """Let all of them go."""
        with self._lock:
            self._results.clear()
