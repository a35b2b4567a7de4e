"""Faults of shapes that real slips have, each with what must notice it.

That is tests, or `bpn verify` of a run that is made with the fault.
"""

import json
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from tests.mutants.modules import modules
from tests.mutants.sampled import SuiteFailsError
from tests.mutants.tree import ROOT, Tree

FILE = Path(__file__).with_name("aimed.toml")
TIMEOUT_S = 240.0


@dataclass(frozen=True, slots=True)
class Fault:
    """One fault.

    Attributes:
        file: of its module.
        find, replace: code of the file; it is found whatever its line breaks and indentation.
        tests: of which one must fail.
        run: options of `bpn train` in which the fault shows; `bpn verify` must say that `named` differs.
    """

    name: str
    file: str
    find: str
    replace: str
    tests: tuple[str, ...] = ()
    run: str = ""
    named: str = ""

    def applied(self, source: str) -> str:
        """The file's source with the fault.

        Raises:
            LookupError: the code that it changes is not there, or there more than once.
        """
        pattern = r"\s*".join(map(re.escape, re.findall(r"\w+|[^\w\s]", self.find)))
        count = len(re.findall(pattern, source))
        if count != 1:
            raise LookupError(f"{self.name}: {self.find!r} stands {count} times in {self.file}")
        return re.sub(pattern, lambda _: self.replace, source)


def faults() -> Iterator[Fault]:
    """All that are written down."""
    told, table = tomllib.loads(FILE.read_text()), modules()
    for entry in told["fault"]:
        file = table[entry.pop("module")].file
        run = told["runs"][entry.pop("run")] if "run" in entry else ""
        yield Fault(**entry | {"file": file, "tests": tuple(entry.get("tests", ())), "run": run})


def noticed_by(fault: Fault, tree: Tree) -> str:
    """What notices the fault, of that which must; "" if nothing does."""
    source = fault.applied((tree.path / fault.file).read_text())
    with tree.changed(fault.file, source):
        if fault.tests:
            done = tree.pytest(fault.tests, TIMEOUT_S)
            if done.outcome in ("deadline", "timeout"):  # which a busy machine does, too
                done = tree.pytest(fault.tests, TIMEOUT_S)
            return "" if done.outcome == "passed" else done.by or done.outcome
        runs, status, said = _run(fault.name, fault.run, tree)
    if status is None:
        return ""
    if status != 0:
        _, as_it_is, why = _run(f"{fault.name} not", fault.run, tree)
        if as_it_is != 0:
            raise SuiteFailsError(f"{fault.name}: its run fails without it, too: {why[-500:]}")
        return f"the run itself: {said.strip().splitlines()[-1:]}"
    difference = differences(runs).get(fault.named)
    return f"bpn verify, {fault.named}: {difference}" if difference else ""


def _run(name: str, options: str, tree: Tree) -> tuple[Path, int | None, str]:
    """A run of the tree's code as it is now: its folder, exit status (None: it did not end), what it printed."""
    runs = tree.path / "runs" / re.sub(r"\W+", "-", name)
    train = ["-m", "bpn", "train", *options.split(), "--json", "--runs-dir", str(runs)]
    return runs, *tree.python(train, TIMEOUT_S)


def differences(runs: Path) -> dict[str, str]:
    """The checks that differ in a folder's only run, each with the first difference, by the code as it is."""
    (run,) = (path.parent.name for path in runs.glob("*/config.json"))
    done = subprocess.run(
        [sys.executable, "-m", "bpn", "verify", run, "--json", "--runs-dir", str(runs)],
        cwd=ROOT, capture_output=True, text=True, timeout=TIMEOUT_S, check=False,
    )  # fmt: skip
    if done.returncode not in (0, 1):
        raise RuntimeError(done.stderr)
    found = {}
    for name, check in json.loads(done.stdout)["checks"].items():
        for difference in check["differences"][:1]:
            told = ("where", "found", "expected", "hint")
            found[name] = "{}: {}, expected {} ({})".format(*(difference[key] for key in told))
    return found
