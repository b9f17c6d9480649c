"""Random paths and their connections to lights and views.

Scene -> layout, starts -> tracer -> PathBank -> endpoint factors. The algorithms of [Bar19] with the
corrections of docs/physics.md, section 2.
"""
