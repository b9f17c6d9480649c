"""Names from elsewhere in files that programs read: a name is shown as it is, and does nothing.

A recipe's title or a parameter's name may come from a store that someone else made.
"""

_MARKS = str.maketrans({mark: f"\\{mark}" for mark in "\\`*_[]<>|#"})


def csv_cell(text: str) -> str:
    """Write a text so that a spreadsheet shows it and does not run it: formulas begin with one of = + - @."""
    return "'" + text if text.startswith(("=", "+", "-", "@", "\t", "\r")) else text


def markdown(text: str) -> str:
    """Write a text so that Markdown shows it on one line, as it is."""
    return " ".join(text.split()).translate(_MARKS)


def cell(text: str) -> str:
    """Write words of our own into a cell of a Markdown table: they may have marks, but end no cell and no line."""
    return " ".join(text.split()).replace("|", "\\|")


def markdown_code(text: str) -> str:
    """Write a text between backquotes, in a table too: none of its own, no bars, no new lines."""
    return "`" + " ".join(text.split()).replace("`", "'").replace("|", "¦") + "`"
