"""Error against run time: estimates of a sampler's run, the errors that it states, and the cost."""

from specklegen.error_time.compare import FACTOR, Row, compare, serving
from specklegen.error_time.estimates import Estimate
from specklegen.error_time.measuring import Cost, measured
from specklegen.error_time.probes import Probes, probes_of
from specklegen.error_time.samplers import SAMPLERS, Sampler
from specklegen.error_time.trends import Trend, crossover, fit_trend

__all__ = [
    "FACTOR", "SAMPLERS", "Cost", "Estimate", "Probes", "Row", "Sampler", "Trend", "compare", "crossover", "fit_trend",
    "measured", "probes_of", "serving",
]  # fmt: skip
