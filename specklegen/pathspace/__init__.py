"""Path-space Monte Carlo in any geometry: boxes, voxels and slabs, near and far, in space and in flatland.

Scene -> volume, sources -> trace -> VolumeBank -> amplitudes -> fields (Algorithms 2, 4) or covariance (1, 3).
[Bar19] Algorithms 1-4 with the corrections of physics.md 2.
"""
