"""The shell of the pages: blocks of commands, and commands in the middle of a sentence or a table."""

import re
import shlex
from functools import cache
from typing import NamedTuple

from scenes import ROOT

PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "SECURITY.md", *sorted((ROOT / "docs").glob("*.md")),
         *sorted((ROOT / "docs").glob("notes/*.md"))]  # fmt: skip
PROGRAMS = r"(?:specklegen|make|pip|pytest|python|dask|torchrun|docker|rattler-build) [^=\n|]"
PLACEHOLDERS = {"RECIPE": "through-slab", "NAME": "through-slab", "FILE": "setup.toml", "DIR": "made"}
"""What pages leave to the reader, and what it is here."""


class Shell(NamedTuple):
    """Lines of shell that belong together."""

    page: str
    line: int
    lines: tuple[str, ...]

    def __str__(self) -> str:
        return f"{self.page}:{self.line}"


@cache
def shells() -> tuple[Shell, ...]:
    """Every block that holds a command, and every command that stands alone, in the order of the pages."""
    found = []
    for page in PAGES:
        text = re.sub(r"^```(?:python|toml)\n.*?^```", _blank, page.read_text(), flags=re.MULTILINE | re.DOTALL)
        for match in re.finditer(_SHELL, text, re.MULTILINE):
            written = match["block"] or match["fence"] or match["span"]
            lines = tuple(line.strip() for line in re.sub(r" *\\\n *", " ", written).splitlines() if line.strip())
            if any(re.match(PROGRAMS, line) for line in lines):
                found.append(Shell(str(page.relative_to(ROOT)), text[: match.start()].count("\n") + 1, lines))
    return tuple(found)


@cache
def commands() -> tuple[str, ...]:
    """Every command once, without comments and placeholders."""
    lines = {plain(line) for shell in shells() for line in shell.lines if re.match(PROGRAMS, line)}
    return tuple(sorted(lines))


def plain(line: str) -> str:
    """A command without the comment and the ampersand behind it, its placeholders filled."""
    words = shlex.split(re.sub(r"\s+#.*$", "", line), posix=False)
    while words[-1] in ("&", "wait"):
        words.pop()
    return " ".join(PLACEHOLDERS.get(word, word) for word in words)


_SHELL = (
    r"(?P<block>(?:^    \S.*\n)+)"  # indented
    r"|^```(?:bash)?\n(?P<fence>(?:.*\n)*?)```"
    rf"|`(?P<span>{PROGRAMS}[^`\n]*)`"
)


def _blank(match: re.Match) -> str:
    """As many empty lines, so that lines keep their numbers."""
    return "\n" * match[0].count("\n")
