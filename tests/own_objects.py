"""A family of objects of a user's own, for tests."""

from specklegen.datasets.objects import Glyphs


class Dim(Glyphs):
    """Characters whose upper half is dark."""

    def picture(self, source, rng):
        """As the parent's, half of it."""
        half = super().picture(source, rng)
        half[: half.shape[0] // 2] = 0
        return half
