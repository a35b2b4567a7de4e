"""That what `make mutants` does is what it says: faults still apply, changes are changes, samples repeat."""

import ast
import json
import shutil
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from tests.mutants import sampled
from tests.mutants.aimed import Fault, faults
from tests.mutants.copies import Copies
from tests.mutants.modules import Module, modules
from tests.mutants.mutations import mutated, mutations
from tests.mutants.results import document, merged
from tests.mutants.sampled import MOST_OF_A_LINE, equivalent, outcomes, sample
from tests.mutants.tree import ROOT, Tree

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
        ("x = f(a, a, strict=True)", set()),
        ("x = not a + b", {"x = a + b", "x = not a - b"}),
        ("raise E", {"pass"}),
        ("if n < 3:\n    log.info(n)", set()),
        ("a.b = c", {"pass"}),
        ("x += 1", {"pass", "x += 2", "x += 0"}),
        ('"""says"""\nlog.info("%d", 3)\nx: int = y', set()),
    ],
)  # fmt: skip
def test_changes_are_those_that_slips_are(source: str, changes: set[str]) -> None:
    assert {mutated(source, mutation) for mutation in mutations(source)} == changes


@pytest.mark.parametrize("module", modules().values(), ids=modules().keys())
def test_a_sample_repeats_and_takes_no_line_too_often(module: Module) -> None:
    file = ROOT / module.file
    chosen = sample(file, 10, seed=1)
    assert chosen == sample(file, 10, seed=1)
    assert chosen[:3] != sample(file, 10, seed=2)[:3]
    lines = [mutation.line for mutation in chosen]
    assert max(map(lines.count, lines)) <= MOST_OF_A_LINE
    source = file.read_text()
    plain = ast.unparse(ast.parse(source))
    assert all(mutated(source, mutation) != plain for mutation in chosen[:3])
    assert all((ROOT / test).exists() for test in module.tests)


def test_what_is_excused_is_still_there() -> None:
    there = {
        (name, mutation.function, mutation.change)
        for name in {name for name, _, _ in equivalent()}
        for mutation in mutations((ROOT / modules()[name].file).read_text())
    }
    assert equivalent().keys() <= there
    assert all(equivalent().values())


SMALL = {
    "small.py": """
def tested(x):
    return x + x

def waited_for():
    return [1]

def counted():
    n = 3
    while n > 0:
        n -= 1
    return n

def forgotten(x):
    return x + x
""",
    "test_small.py": """
import pytest, small

def test_without_it():
    pass

def test_a_wait():
    if small.waited_for() != [1]:
        pytest.fail("waited 20 s for news")

def test_sum():
    assert small.tested(3) == 6

def test_count():
    assert small.counted() == 0
""",
}


@pytest.fixture
def small(tmp_path: Path) -> Iterator[Tree]:
    source = tmp_path / "source"
    (source / "tests" / "mutants").mkdir(parents=True)
    for name in ("pytest_order.py", "warm.py"):
        shutil.copy(ROOT / "tests" / "mutants" / name, source / "tests" / "mutants")
    for name, text in SMALL.items():
        (source / name).write_text(text)
    tree = Tree(tmp_path / "copy", source, libraries=["hypothesis"])
    yield tree
    tree.close()


def test_verdicts_are_of_the_tests_that_run_what_changed(
    small: Tree, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sampled, "_GRACE_CPU_S", 1.0)
    module = Module("small", "small.py", ("test_small.py",))
    wanted = ("return x", "return [1]", "n -= 1 removed")
    chosen = [m for m in mutations(SMALL["small.py"]) if m.change.startswith(wanted)]
    found = {m.function: (verdict, by) for m, verdict, by in outcomes(small, module, chosen)}
    assert found == {
        "tested": ("killed", "test_small.py::test_sum"),
        "waited_for": ("hung", "test_small.py::test_a_wait"),
        "counted": ("hung", ""),
        "forgotten": ("survived", ""),
    }
    assert (small.path / "small.py").read_text() == SMALL["small.py"]
    order = json.loads((small.path / "order.json").read_text())
    assert len(order) == 4


def test_tests_that_fail_without_a_change_are_said(small: Tree) -> None:
    module = Module("small", "small.py", ("test_small.py",))
    (small.path / "small.py").write_text("tested = waited_for = None")
    with pytest.raises(RuntimeError, match="do not pass as it is"):
        list(outcomes(small, module, [*mutations(SMALL["small.py"])]))


def test_what_is_equivalent_does_not_count() -> None:
    records = [
        {"what": str(number), "module": "m", "verdict": verdict, "by": "why"}
        for number, verdict in enumerate(["killed", "hung", "survived", "equivalent", "killed"])
    ]
    aimed = [
        {"what": "a", "verdict": "noticed", "by": "bpn verify, seeds: 1"},
        {"what": "b", "verdict": "missed", "by": ""},
    ]
    found = document(aimed, records, seed=3)
    total = found["sampled"]["total"]
    assert (total["changes"], total["counted"], total["noticed"], total["share"]) == (5, 4, 3, 0.75)
    assert found["sampled"]["survivors"] == ["2"]
    assert found["sampled"]["equivalent"] == {"3": "why"}
    assert (found["aimed"]["share"], found["aimed"]["by_verify"]) == (0.5, 1)
    assert found["how"] == {"seed": 3}


def test_what_was_not_tried_this_time_stays_from_before() -> None:
    def found(verdicts: dict[str, str], aimed: dict[str, str]) -> dict[str, Any]:
        sampled = [
            {"what": f"{name}:1 f: x", "module": name, "verdict": verdict, "by": "why"}
            for name, verdict in verdicts.items()
        ]
        faults = [
            {"what": name, "verdict": verdict, "by": "t" * (verdict == "noticed")}
            for name, verdict in aimed.items()
        ]
        return document(faults, sampled)

    before = found(
        {"a": "survived", "b": "survived", "c": "killed", "d": "equivalent"},
        {"x": "missed", "y": "noticed", "z": "untried"},
    )
    now = found({"a": "killed", "c": "untried", "d": "survived"}, {"x": "noticed", "z": "missed"})
    both = merged(before, now)
    assert both["sampled"]["survivors"] == ["b:1 f: x", "d:1 f: x"]
    assert both["sampled"]["equivalent"] == {}
    assert both["sampled"]["modules"]["c"]["killed"] == 1
    total = both["sampled"]["total"]
    assert (total["changes"], total["counted"], total["noticed"]) == (4, 4, 2)
    assert (both["aimed"]["missed"], [*both["aimed"]["by"]]) == (["z"], ["y", "x"])
    assert (both["aimed"]["faults"], both["aimed"]["tried"]) == (3, 3)


def test_things_are_tried_beside_each_other_each_in_a_copy_of_its_own() -> None:
    trees = [object(), object()]
    both_at_once = threading.Barrier(2, timeout=20)

    def attempt(tree: object, item: int) -> tuple[object, int]:
        both_at_once.wait()
        return tree, item

    with ThreadPoolExecutor(2) as pool:
        found = [*Copies(trees, pool).try_each(attempt, range(6))]  # type: ignore[arg-type]
    assert [item for _, item in found] == [*range(6)]
    for first in range(0, 6, 2):
        assert {id(tree) for tree, _ in found[first : first + 2]} == {*map(id, trees)}


def test_the_copys_code_is_what_runs(tmp_path: Path) -> None:
    """Also of packages with compiled code, whose editable installation is found before PYTHONPATH."""
    source = tmp_path / "source"
    packages = sorted({module.file.split("/bpn")[0] for module in modules().values()})
    for package in packages:
        ignore = shutil.ignore_patterns(
            "node_modules", "build", "static", "web", "rtl", "__pycache__"
        )
        shutil.copytree(ROOT / package, source / package, ignore=ignore)
    tree = Tree(tmp_path / "copy", source)
    names = ("bpn_shared", "bpn_edge", "bpn_learner", "bpn_robot_sim", "bpn_dashboard")
    shown = "; ".join(f"import {name}; print({name}.__file__)" for name in names)
    status, output = tree.python(["-c", shown], 60)
    assert status == 0
    assert all(line.startswith(str(tree.path)) for line in output.splitlines()), output
