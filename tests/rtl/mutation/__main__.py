"""How many random faults in the core's RTL the tests notice: `python -m tests.rtl.mutation --sample 300 --seed 1`.

A mutant differs in one place: an operator, a constant, a condition, a choice, an assignment left out. They are
tried in an order that is drawn once, so that those tried so far are a fair sample of all; goes on where it was.
Each runs the tests until one fails, the quickest first, then the proofs; those that live are listed.
"""

import argparse
import contextlib
import hashlib
import io
import json
import os
import random
import resource
import sys
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from pathlib import Path

import pytest

from bpn_edge.fpga import sources
from tests.rtl.mutation import model
from tests.rtl.mutation.places import Mutant

HERE = Path(__file__).parents[1]
TESTS = (
    "test_exact.py::test_sizes_at_the_engines_seams",
    "test_stacked.py",
    "test_refusals.py",
    "test_swaps.py",
    "test_exact.py",
)
NOT = "not other_builds and not does_not_answer and not given_up"
"""Other builds have models of their own, and two tests are about waiting."""
_LONGEST_S = 600
"""Of processor time: whoever takes longer hangs, which is noticed."""


def begin(number: int, proofs: Callable[[], bool]) -> int:
    """Runs tests and proofs in a process of its own, which has everything imported already; its id."""
    child = os.fork()
    if child == 0:
        os.environ[model.CHOSEN] = str(number)
        resource.setrlimit(resource.RLIMIT_CPU, (_LONGEST_S, _LONGEST_S))
        failed = True
        with contextlib.suppress(BaseException), contextlib.redirect_stdout(io.StringIO()):
            tests = [str(HERE / test) for test in TESTS]
            options = ["-q", "-x", "-p", "no:cacheprovider", "--timeout=0", "-k", NOT]
            failed = pytest.main([*options, *tests]) != 0 or not proofs()
        os._exit(failed)
    return child


def outcomes(
    mutants: Iterable[tuple[Mutant, int]], jobs: int, proofs: Callable[[Mutant], bool]
) -> Iterator[tuple[Mutant, bool]]:
    """Whether a test or a proof fails with each, some of them beside each other."""
    running: dict[int, Mutant] = {}
    for mutant, number in mutants:
        if len(running) == jobs:
            child, status = os.wait()
            yield running.pop(child), status != 0
        running[begin(number, partial(proofs, mutant))] = mutant
    while running:
        child, status = os.wait()
        yield running.pop(child), status != 0


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sample", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--again", action="store_true", help="those that lived, with other tests")
    parser.add_argument("--where", type=Path, default=HERE.parents[1] / "build/rtl-mutants")
    parser.add_argument("--report", action="store_true", help="only what is known of those tried")
    parser.add_argument("--out", type=Path, help="a JSON file with that")
    options = parser.parse_args()
    files, original = model.rtl(), sources.folder()
    mutants = [mutant for file in files for mutant in file.mutants()]
    random.Random(options.seed).shuffle(mutants)
    sample = {mutant: number for number, mutant in enumerate(mutants[: options.sample], 1)}
    digest = hashlib.sha256("".join(file.text for file in files).encode()).hexdigest()[:12]
    where = options.where.resolve() / f"{digest}-{options.seed}-{options.sample}"
    results = options.where.resolve() / f"{digest}-{options.seed}.jsonl"
    lines = results.read_text().splitlines() if results.exists() else []
    known: dict[str, bool] = {row["mutant"]: row["noticed"] for row in map(json.loads, lines)}
    if not options.report:
        model.write(files, sample, where / "rtl")
        model.use(where / "rtl")
        if os.waitpid(begin(0, lambda: True), 0)[1]:
            print("the tests fail with the core as it is")
            return 1
        todo = [
            (mutant, number)
            for mutant, number in sample.items()
            if _name(mutant) not in known or (options.again and not known[_name(mutant)])
        ]
        with results.open("a") as file:
            proofs = partial(model.is_proven, files=files, original=original)
            for mutant, was_noticed in outcomes(todo, options.jobs, proofs):
                known[_name(mutant)] = was_noticed
                file.write(json.dumps({"mutant": _name(mutant), "noticed": was_noticed}) + "\n")
                file.flush()
    _report(
        [mutant for mutant in sample if _name(mutant) in known], known, len(mutants), options.out
    )
    return 0


def _report(tried: list[Mutant], known: dict[str, bool], of: int, out: Path | None) -> None:
    lived = [str(mutant) for mutant in tried if not known[_name(mutant)]]
    print(*lived, sep="\n")
    noticed = len(tried) - len(lived)
    print(f"{noticed} of {len(tried)} mutants noticed, of {of} that there are")
    if out:
        found = {"of": of, "tried": len(tried), "noticed": noticed, "lived": lived}
        out.write_text(json.dumps(found, indent=1) + "\n")


def _name(mutant: Mutant) -> str:
    return f"{mutant.file}@{mutant.begin}-{mutant.end}: {mutant.line} -> {mutant.after}"


if __name__ == "__main__":
    sys.exit(main())
