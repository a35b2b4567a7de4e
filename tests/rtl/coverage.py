"""What of the core's RTL the tests reach: `python -m tests.rtl.coverage`, lines, branches and toggles by module.

Counted by Verilator over all simulated cores of the tests, of the usual build and of one that keeps a frame.
"""

import argparse
import itertools
import json
import os
import re
import sys
import tempfile
from collections import Counter
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console
from rich.table import Table

from bpn_edge.fpga import simulated, sources, verilated
from bpn_edge.fpga.build import Build

HERE = Path(__file__).parent
TESTS = ("test_exact.py", "test_stacked.py", "test_refusals.py", "test_swaps.py")
NOT = "not other_builds and not given_up"
KINDS = ("line", "branch", "toggle")
_COVER = """
extern "C" void bpn_cover(void *model, const char *path) { of(model).context.coveragep()->write(path); }
"""


class CoveredCore(simulated.SimulatedCore):
    """A core that says, when it is closed, what of it was reached."""

    where: Path
    numbers = itertools.count()

    def close(self) -> None:
        if self._model:
            path = self.where / f"{os.getpid()}-{next(self.numbers)}.dat"
            self._library.bpn_cover(self._model, os.fsencode(path))
        super().close()


def points(path: Path) -> Counter[tuple[str, str, str]]:
    """How often each point was reached, by kind, module and place."""
    found: Counter[tuple[str, str, str]] = Counter()
    for line in path.read_text(errors="replace").splitlines():
        if not line.startswith("C "):
            continue
        what, count = line[3:].rsplit("' ", 1)
        fields = dict(part.split("\2", 1) for part in what.split("\1")[1:])
        kind, _, module = fields["page"].removeprefix("v_").partition("/")
        place = f"{fields['f']}:{fields['l']}:{fields.get('n')}:{fields['o']}"
        found[kind, re.sub(r"__\w+$", "", module), place] += int(count)
    return found


def measure() -> dict[str, dict[str, list[int]]]:
    """Runs the tests: points that were reached, and all, by kind, by module.

    Raises:
        RuntimeError: a test fails.
    """
    with tempfile.TemporaryDirectory() as made:
        where = Path(made)
        model = where / "bpn_model.cpp"
        model.write_text((sources.folder() / "sim/bpn_model.cpp").read_text() + _COVER)
        harness = verilated.Harness(
            "bpn_core",
            str(model),
            options=("--coverage-line", "--coverage-toggle"),
            flags=("-UVM_COVERAGE", "-DVM_COVERAGE=1"),
            runtime=("verilated_cov.cpp",),
        )
        os.environ[verilated.CACHE] = made
        CoveredCore.where = where
        vars(simulated).update(
            model_library=lambda build: verilated.model_library(build, harness),
            SimulatedCore=CoveredCore,
        )
        for build in (Build(), Build(keeps_frame=True)):
            simulated.model_library(build)
        tests = [str(HERE / test) for test in TESTS]
        if pytest.main(["-q", "-x", "-p", "no:cacheprovider", "--timeout=0", "-k", NOT, *tests]):
            raise RuntimeError("a test fails")
        total: Counter[tuple[str, str, str]] = Counter()
        for path in where.glob("*.dat"):
            total.update(points(path))
    result: dict[str, dict[str, list[int]]] = {}
    for (kind, module, _), count in sorted(total.items()):
        reached = result.setdefault(module, {}).setdefault(kind, [0, 0])
        reached[0] += count > 0
        reached[1] += 1
    return result


def overall(result: dict[str, dict[str, list[int]]]) -> dict[str, Any]:
    """Shares over all modules."""
    sums = {
        kind: [sum(by_kind.get(kind, [0, 0])[i] for by_kind in result.values()) for i in (0, 1)]
        for kind in KINDS
    }
    return {kind: round(reached / of, 4) for kind, (reached, of) in sums.items()}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, help="a JSON file")
    options = parser.parse_args()
    result = measure()
    table = Table("module", *KINDS)
    for module, by_kind in result.items():
        cells = (by_kind.get(kind) for kind in KINDS)
        table.add_row(module, *(f"{cell[0]} of {cell[1]}" if cell else "" for cell in cells))
    share = overall(result)
    table.add_row("all", *(f"{share[kind]:.1%}" for kind in KINDS))
    Console().print(table)
    if options.out:
        rows = ",\n".join(
            f"  {json.dumps(name)}: {json.dumps(row)}" for name, row in result.items()
        )
        options.out.write_text(
            f'{{\n "command": "python -m tests.rtl.coverage",\n "overall": {json.dumps(share)},\n'
            f' "modules": {{\n{rows}\n }}\n}}\n'
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
