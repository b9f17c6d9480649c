"""Tasks at a seed that an organiser keeps to himself: nobody can learn from, or look up, what it draws.

The seed is the SHA-256 of some words; results state another SHA-256 of the same words, the commitment, from which
neither words nor seed can be told. Who tells the words later proves which they were.
"""

import hashlib

from specklegen.core.errors import reject

LEAST = 16
"""Characters of the words: fewer could be tried out until the commitment comes out."""


def seed_of(words: str) -> int:
    """Seed of the tasks, a whole number below 2^63."""
    return int.from_bytes(_digest("seed", words)[:8], "big") >> 1


def commitment(words: str) -> str:
    """What results state, 64 hexadecimal digits."""
    return _digest("commitment", words).hex()


def require_words(words: str, stated: str) -> None:
    """Refuse words that a stated commitment is not of.

    Raises
    ------
    RuleError
        If they are not.
    """
    if commitment(words) != stated:
        reject("benchmark secret", f"the words of the commitment {stated[:12]}", commitment(words)[:12])


def _digest(what: str, words: str) -> bytes:
    if not isinstance(words, str) or len(words) < LEAST:
        reject("benchmark secret", f"a text of at least {LEAST} characters, such as six words drawn by lot",
               f"{len(words)} characters" if isinstance(words, str) else words)  # fmt: skip
    return hashlib.sha256(f"specklegen benchmark {what}\n{words}".encode()).digest()
