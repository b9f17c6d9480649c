"""Source of the random numbers of a batch of media."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    import torch

    from specklegen.synthesis.correlations import Places


class Streams(NamedTuple):
    """Keys of B media.

    Attributes
    ----------
    keys : int64[B, halves, F, 2]
        Of their fields: of both polarisations, frame by frame.
    still : float64[B]
        Correlation of the fields of one frame with the next.
    words : int64[B, halves, n]
        The same as seeds, for whoever draws something else than fields.
    shares : float64[B, halves] or None
        Of the light in each polarisation; None where all have the same.
    """

    keys: torch.Tensor
    still: torch.Tensor
    words: torch.Tensor
    shares: torch.Tensor | None = None

    def at(self, places: Places) -> Streams:
        """Return the streams of some of the media."""
        shares = None if self.shares is None else self.shares[places]
        return Streams(self.keys[places], self.still[places], self.words[places], shares)
