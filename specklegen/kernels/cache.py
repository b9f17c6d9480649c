"""The cache of compiled kernels: one file of :mod:`specklegen.disk_cache` for a kernel and the types of its arguments.

Numba notices a change in the file of a function, but not in the files of the functions that it calls, and asks for the
same path and the same time of the last change. Here the digest of all sources decides.
"""

import pickle
import sys
from pathlib import Path
from typing import Any

import numba
from numba import config
from numba.core.caching import NullCache
from numba.core.compiler import CompileResult
from numba.core.runtime import rtsys
from numba.core.serialize import dumps

from specklegen.disk_cache import name_of, read, source_digest, write

KIND = "kernels"


class KernelCache(NullCache):
    """The cache of one kernel."""

    def __init__(self, function: Any) -> None:
        code = function.__code__
        sources = source_digest(Path(code.co_filename))  # now: the file may change before the kernel is called
        compiler = numba.__version__, config.OPT, config.BOUNDSCHECK, sys.version_info
        self._about = sources, *compiler, code.co_qualname, code.co_firstlineno

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Read a compiled kernel; None where there is none.

        Numba imports here all that it can translate, 0.4 s of a process, of which machine code needs the addresses of
        the runtime alone; code that compiles imports it then.
        """
        rtsys.initialize(target_context)
        content = read(KIND, self._name(sig, target_context.codegen()))
        types, reduced = (None, ()) if content is None else pickle.loads(content)
        return CompileResult._rebuild(target_context, *reduced) if types == sig else None

    def save_overload(self, sig: Any, cres: Any) -> None:
        """Write a compiled kernel, unless it holds addresses of this process, as code without optimisation does."""
        if not cres.library.has_dynamic_globals:
            write(KIND, self._name(sig, cres.codegen), dumps((sig, cres._reduce())))

    def _name(self, sig: Any, codegen: Any) -> str:
        return name_of(*self._about, sig, codegen.magic_tuple())
