"""A random sample of small changes to the core modules, each tried against the tests meant for its module."""

import random
import time
import tomllib
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

from tests.mutants.mutations import Mutation, mutated, mutations
from tests.mutants.tree import ROOT, Tree

MODULES = Path(__file__).with_name("modules.toml")
EQUIVALENT = Path(__file__).with_name("equivalent.toml")
MOST_OF_A_LINE = 2
_PATIENCE = 3.0
_GRACE_S = 20.0


def tests_of_modules() -> dict[str, list[str]]:
    """By file: the tests that are meant for it."""
    return tomllib.loads(MODULES.read_text())


def equivalent() -> dict[tuple[str, str, str], str]:
    """(file, function, change) of changes that change nothing: why."""
    entries = tomllib.loads(EQUIVALENT.read_text()).get("equivalent", [])
    return {(e["file"], e["function"], e["change"]): e["reason"] for e in entries}


def sample(file: str, count: int, seed: int) -> list[Mutation]:
    """Changes of a file, at most two of a line: the same for the same file and seed."""
    found = list(mutations((ROOT / file).read_text()))
    random.Random(f"{seed} {file}").shuffle(found)
    of_line: Counter[int] = Counter()
    chosen: list[Mutation] = []
    for mutation in found:
        of_line[mutation.line] += 1
        if of_line[mutation.line] <= MOST_OF_A_LINE:
            chosen.append(mutation)
    return chosen[:count]


def outcomes(
    tree: Tree, file: str, tests: Sequence[str], chosen: Sequence[Mutation]
) -> Iterator[tuple[Mutation, str, str]]:
    """For every change "killed", "survived" or "timeout", and what noticed it.

    Raises:
        RuntimeError: the tests fail without any change.
    """
    if not chosen:
        return
    began_s = time.monotonic()
    outcome, said = tree.pytest(tests, 900)
    if outcome != "passed":
        raise RuntimeError(f"tests of {file} do not pass as it is: {said}")
    timeout_s = _GRACE_S + _PATIENCE * (time.monotonic() - began_s)
    for mutation in chosen:
        source = mutated((tree.path / file).read_text(), mutation)
        with tree.changed(file, source):
            outcome, said = tree.pytest(tests, timeout_s)
        yield mutation, {"passed": "survived", "failed": "killed"}.get(outcome, outcome), said
