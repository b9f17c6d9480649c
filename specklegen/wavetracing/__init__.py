"""Wave tracing: light through openings and past edges, as fields and as sampled beams [Steinberg].

Public names stand in ``__init__.pyi``; when to believe what, in docs/wavetracing.md. Only `coupling` knows the engine.
"""

from specklegen.core.extras import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
