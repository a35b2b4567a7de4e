"""What is typed at several machines, and what they print."""

import itertools
import re
import shlex
import subprocess
import sys
from pathlib import Path

from namespaces import NetworkMachine

_numbers = itertools.count()
_BIN = Path(sys.executable).parent


def typed(line: str) -> list[str]:
    """What a shell would start for a command of ours."""
    program, *words = shlex.split(line)
    return [str(_BIN / program), *words]


class Typed:
    """A command that goes on, and what it has printed so far."""

    def __init__(self, at: NetworkMachine, line: str) -> None:
        at.home.mkdir(exist_ok=True)
        self._path = at.home / f"said-{next(_numbers)}"
        with self._path.open("w") as file:
            self.process = at.popen(typed(line), stdout=file, stderr=subprocess.STDOUT)

    def text(self) -> str:
        """So far; it must be running still."""
        text = self._path.read_text()
        assert self.process.poll() is None, text
        return text

    def printed(self, pattern: str) -> str | None:
        """What it has printed that looks so."""
        found = re.search(pattern, self.text())
        return None if found is None else found[0]
