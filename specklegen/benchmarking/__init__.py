"""Error against run time: what a sampler's run estimates, how far off it says it is, and what that cost."""

from specklegen.benchmarking.bench import FACTOR, Row, bench, serving
from specklegen.benchmarking.estimates import Estimate
from specklegen.benchmarking.measuring import Cost, measured
from specklegen.benchmarking.probes import Probes, probes_of
from specklegen.benchmarking.samplers import SAMPLERS, Sampler
from specklegen.benchmarking.trends import Trend, crossover, fit_trend

__all__ = [
    "FACTOR",
    "SAMPLERS",
    "Cost",
    "Estimate",
    "Probes",
    "Row",
    "Sampler",
    "Trend",
    "bench",
    "crossover",
    "fit_trend",
    "measured",
    "probes_of",
    "serving",
]
