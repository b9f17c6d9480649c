"""What every test process begins with."""

import signal

# A shell without job control starts background work with Ctrl-C ignored, and processes inherit that; the tests that
# press it want it as in a terminal.
signal.signal(signal.SIGINT, signal.default_int_handler)
