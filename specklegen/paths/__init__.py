"""Random paths and their connections to lights and views.

Scene -> layout, starts -> tracer -> PathBank -> endpoint factors. [Bar19] Algorithms 1-4 with the corrections of
docs/physics.md, section 2.
"""
