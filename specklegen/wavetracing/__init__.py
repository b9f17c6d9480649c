"""Wave tracing: light through openings and past edges, as fields and as sampled beams [Steinberg].

Public names stand in ``__init__.pyi``; when to believe what, in docs/wavetracing.md. Only `coupling` knows the engine.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
