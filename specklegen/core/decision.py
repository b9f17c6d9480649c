"""Decisions: what a scene needs, and why. The planner folds them; pipelines obey them."""


from dataclasses import dataclass


@dataclass(frozen=True)
class Decision:
    """Whether one part of the physics takes part, with the reason in words.

    Attributes
    ----------
    part : str
        The part judged.
    needed : bool
        Whether it takes part.
    reason : str
        Why, for a reader of ``plan(...).explain()``.
    """

    part: str
    needed: bool
    reason: str


