"""A random sample of small changes to the core modules, each tried against the tests meant for its module."""

import json
import random
import time
import tomllib
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from tests.mutants.modules import Module
from tests.mutants.mutations import Mutation, mutated, mutations
from tests.mutants.tree import Done, Tree

EQUIVALENT = Path(__file__).with_name("equivalent.toml")
MOST_OF_A_LINE = 2
_PATIENCE = 3.0
_GRACE_S = 60.0
_GRACE_CPU_S = 5.0
_AS_IT_IS_S = 900.0

Verdict = Literal["killed", "hung", "survived"]
"""hung: the tests did not end, or something did not happen in time, twice, which it does without the change."""


class SuiteFailsError(RuntimeError):
    """A module's tests, or a run, fail though nothing was changed: they would tell nothing."""


def equivalent() -> dict[tuple[str, str, str], str]:
    """(module, function, change) of changes that change nothing: why."""
    entries = tomllib.loads(EQUIVALENT.read_text()).get("equivalent", [])
    return {(e["module"], e["function"], e["change"]): e["reason"] for e in entries}


def sample(file: Path, count: int, seed: int) -> list[Mutation]:
    """Changes of a file, at most two of a line: the same for the same file and seed."""
    found = list(mutations(file.read_text()))
    random.Random(f"{seed} {file.name}").shuffle(found)
    of_line: Counter[int] = Counter()
    chosen: list[Mutation] = []
    for mutation in found:
        of_line[mutation.line] += 1
        if of_line[mutation.line] <= MOST_OF_A_LINE:
            chosen.append(mutation)
    return chosen[:count]


def outcomes(
    tree: Tree, module: Module, chosen: Sequence[Mutation]
) -> Iterator[tuple[Mutation, Verdict, str]]:
    """For every change whether it is noticed, and by which test.

    Raises:
        SuiteFailsError: without any change, too.
    """
    if not chosen:
        return
    suite = _Suite(tree, module)
    for mutation in chosen:
        with tree.changed(module.file, mutated((tree.path / module.file).read_text(), mutation)):
            done = suite.run(mutation.function)
            if done.outcome in ("deadline", "timeout"):  # which a busy machine does, too
                done = suite.run(mutation.function)
        verdict: Verdict = "hung"
        if done.outcome in ("passed", "failed"):
            verdict = "survived" if done.outcome == "passed" else "killed"
        yield mutation, verdict, done.by


@dataclass(frozen=True, slots=True)
class _Note:
    """What pytest_order tells of a test."""

    seconds: float
    functions: Sequence[str]

    def runs(self, function: str) -> bool:
        return any(f"{name}.".startswith(f"{function}.") for name in self.functions)


class _Suite:
    """A module's tests. Those that run the function that is changed come first, and of these the fastest."""

    def __init__(self, tree: Tree, module: Module) -> None:
        self._tree, self._tests = tree, module.tests
        notes, self._order = tree.path / "notes.json", tree.path / "order.json"
        began_s = time.monotonic()
        for _ in range(3):
            note = ("--note", module.file, str(notes))
            done = tree.pytest(module.tests, _AS_IT_IS_S, *note)
            if done.outcome == "passed":
                break
        else:
            raise SuiteFailsError(f"tests of {module.file} do not pass as it is: {done}")
        self._timeout_s = _GRACE_S + _PATIENCE * (time.monotonic() - began_s)
        self._cpu_s = _GRACE_CPU_S + _PATIENCE * done.cpu_s
        told: dict[str, Any] = json.loads(notes.read_text())
        self._notes = {test: _Note(**note) for test, note in told.items()}
        self._seconds: dict[str, float] = defaultdict(float)  # by file
        for test, noted in self._notes.items():
            self._seconds[_file(test)] += noted.seconds

    def run(self, function: str) -> Done:
        def rank(test: str) -> tuple[float, str, bool, float]:
            note, file = self._notes[test], _file(test)
            return self._seconds[file], file, not note.runs(function), note.seconds

        self._order.write_text(json.dumps(sorted(self._notes, key=rank)))
        order = ("--order", str(self._order))
        return self._tree.pytest(self._tests, self._timeout_s, *order, cpu_s=self._cpu_s)


def _file(test: str) -> str:
    return test.partition("::")[0]
