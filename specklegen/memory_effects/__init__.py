"""The memory effect: how much of a speckle pattern stays under a tilt and a shift; its correlation K and K's tables."""
