"""What every test process begins with."""

import os
import signal

# A shell without job control starts background work with Ctrl-C ignored, and processes inherit that; the tests that
# press it want it as in a terminal.
signal.signal(signal.SIGINT, signal.default_int_handler)

# Tests change what results are made of, and look at how they are computed: compiled kernels alone are cached. Tests of
# the cache name a folder for all of it.
_CACHE = os.environ.get("SPECKLEGEN_CACHE", "")
if _CACHE != "off":
    os.environ["SPECKLEGEN_CACHE"] = "kernels:" + _CACHE.removeprefix("kernels:")
