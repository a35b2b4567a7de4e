"""That what `make mutants` does is what it says: faults still apply, changes are changes, samples repeat."""

import ast

import pytest

from tests.mutants.aimed import Fault, faults
from tests.mutants.mutations import mutated, mutations
from tests.mutants.sampled import MOST_OF_A_LINE, equivalent, sample
from tests.mutants.sampled import tests_of_modules as meant_for
from tests.mutants.tree import ROOT

CHECKED_BY_VERIFY = {
    "initial weights", "seeds", "outputs", "actions", "rewards", "returns", "epsilon", "updates",
    "targets", "weights", "digests",
}  # fmt: skip


@pytest.mark.parametrize("fault", [*faults()], ids=lambda fault: fault.name)
def test_every_fault_still_changes_the_code(fault: Fault) -> None:
    source = (ROOT / fault.file).read_text()
    changed = fault.applied(source)
    assert ast.dump(ast.parse(changed)) != ast.dump(ast.parse(source))
    assert bool(fault.tests) != bool(fault.run and fault.named)
    assert all((ROOT / test).exists() for test in fault.tests)


def test_faults_have_names_of_their_own_and_aim_at_every_check() -> None:
    names = [fault.name for fault in faults()]
    assert len(set(names)) == len(names) >= 40
    assert {fault.named for fault in faults() if fault.run} == CHECKED_BY_VERIFY


def test_a_fault_that_no_longer_applies_is_said() -> None:
    fault = Fault("gone", "shared/bpn_shared/spec/seeds.py", "no such code", "")
    with pytest.raises(LookupError, match="stands 0 times"):
        fault.applied("x = 1\n")


@pytest.mark.parametrize(
    ("source", "changes"),
    [
        ("x = a < b", {"x = a <= b"}),
        ("if a and b:\n    f()", {"if not (a and b):\n    f()", "if a or b:\n    f()", "if a and b:\n    pass"}),
        ("def f(n=3):\n    return n", {"def f(n=4):\n    return n", "def f(n=2):\n    return n",
                                         "def f(n=3):\n    return None"}),
        ("f(a, b, c=1)", {"pass", "f(b, a, c=1)", "f(a, b)", "f(a, b, c=2)", "f(a, b, c=0)"}),
        ("x = not a + b", {"x = a + b", "x = not a - b"}),
        ("raise E", {"pass"}),
        ("a.b = c", {"pass"}),
        ("x += 1", {"pass", "x += 2", "x += 0"}),
        ('"""says"""\nlog.info("%d", 3)\nx: int = y', set()),
    ],
)  # fmt: skip
def test_changes_are_those_that_slips_are(source: str, changes: set[str]) -> None:
    assert {mutated(source, mutation) for mutation in mutations(source)} == changes


@pytest.mark.parametrize("file", meant_for())
def test_a_sample_repeats_and_takes_no_line_too_often(file: str) -> None:
    chosen = sample(file, 10, seed=1)
    assert chosen == sample(file, 10, seed=1)
    assert chosen[:3] != sample(file, 10, seed=2)[:3]
    lines = [mutation.line for mutation in chosen]
    assert max(map(lines.count, lines)) <= MOST_OF_A_LINE
    source = (ROOT / file).read_text()
    assert all(mutated(source, m) != ast.unparse(ast.parse(source)) for m in chosen)
    assert all((ROOT / test).exists() for test in meant_for()[file])


def test_what_is_excused_is_still_there() -> None:
    there = {
        (file, mutation.function, mutation.change)
        for file in {file for file, _, _ in equivalent()}
        for mutation in mutations((ROOT / file).read_text())
    }
    assert equivalent().keys() <= there
