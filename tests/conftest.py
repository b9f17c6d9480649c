"""What every test process begins with."""

import os
import signal

# A shell without job control starts background work with Ctrl-C ignored, and processes inherit that; the tests that
# press it want it as in a terminal.
signal.signal(signal.SIGINT, signal.default_int_handler)

# Tests change what pilots are made of, and look at how they are made; those of what is kept of them ask for it.
os.environ["SPECKLEGEN_PILOTS"] = "anew"
