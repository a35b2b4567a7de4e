"""Markdown tables."""

from collections.abc import Sequence


def table(heading: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """A table whose first column is aligned left and all others right."""
    lines = [
        " | ".join(map(str, row)) for row in (heading, ["---", *["---:"] * (len(heading) - 1)])
    ]
    lines += [" | ".join(map(str, row)) for row in rows]
    return "\n".join(f"| {line} |" for line in lines)
