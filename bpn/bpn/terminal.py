"""Standard output and standard error: no character is refused, and results are alone on standard output."""

import codecs
import os
import shlex
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

_SPELLED = {
    "±": "+-", "≥": ">=", "≤": "<=", "–": "-", "—": "-", "×": "x", "°": " deg", "λ": "lambda", "…": "...",
    "α": "alpha", "β": "beta", "γ": "gamma", "“": '"', "”": '"', "’": "'",
}  # fmt: skip
"""Characters of messages and help that not every terminal can show, in ones that it can."""


def spare_encoding() -> None:
    """From now on a character that a terminal cannot show is spelled, so that no result is lost over it."""
    codecs.register_error("bpn.spell", _spell)
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):  # a test's or notebook's stream may not be
            stream.reconfigure(errors="bpn.spell")


def _spell(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    text = error.object[error.start : error.end]
    return "".join(_SPELLED.get(one, "?") for one in text), error.end


@contextmanager
def stdout_for_results() -> Iterator[None]:
    """What foreign code prints in the body goes to standard error: results are alone on standard output.

    Below Python too, where C libraries print.
    """
    sys.stdout.flush()
    kept, printed_to = os.dup(1), sys.stdout
    try:
        os.dup2(2, 1)
        sys.stdout = sys.stderr
        yield
    finally:
        sys.stdout = printed_to
        os.dup2(kept, 1)
        os.close(kept)


def command(*words: str | Path) -> str:
    """A command to copy: quoted as a shell needs it."""
    return shlex.join(map(str, words))
