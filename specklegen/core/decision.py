"""Decisions: what a scene needs, and why. They stand beside their physics; the planner folds them, samplers obey."""


from dataclasses import dataclass


@dataclass(frozen=True)
class Decision:
    """Decision about one part of the physics: taken or left out, with the reason in words.

    Attributes
    ----------
    part : str
        The part judged.
    needed : bool
        Whether it takes part.
    reason : str
        Why, for a reader of ``plan(...).explain()``.
    doubt : bool
        Whether the part was asked for although its rule is against it.
    error : float
        How far off intensity correlations or means are by it, where the rule tells.
    """

    part: str
    needed: bool
    reason: str
    doubt: bool = False
    error: float = 0.0

    @property
    def idealised(self) -> bool:
        """Return whether a part is left out that the real thing has."""
        return not self.needed and self.reason.startswith("idealised: ")
