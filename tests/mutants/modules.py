"""The core modules, by name: where each is, and the tests that are meant for it."""

import tomllib
from dataclasses import dataclass
from pathlib import Path

FILE = Path(__file__).with_name("modules.toml")


@dataclass(frozen=True, slots=True)
class Module:
    """One row of the table.

    Attributes:
        file: from the root of the code.
        tests: of which one must fail when the module changes.
        share: how many changes of it are sampled, in multiples of what others have.
    """

    name: str
    file: str
    tests: tuple[str, ...]
    share: int = 1


def modules() -> dict[str, Module]:
    """All of the table, by name."""
    rows = tomllib.loads(FILE.read_text())
    return {
        name: Module(name, row["file"], tuple(row["tests"]), row.get("share", 1))
        for name, row in rows.items()
    }
