"""`bpn verify`: recomputes what a run folder says, in code of its own (docs/verify.md)."""

import argparse
import json
from collections.abc import Sequence
from typing import Any

from rich.console import Console

from bpn.options import add_runs_dir
from bpn.progress import bar
from bpn.verify.findings import CHECKS, Findings
from bpn.verify.verification import Verification, what_is_trusted
from bpn_shared.runs.folder import RunFolder

_SHOWN = 3


def add_options(parser: argparse.ArgumentParser, _arguments: Sequence[str]) -> None:
    parser.add_argument("run_id", metavar="RUN", help="id of the run, or its end")
    parser.add_argument(
        "--elsewhere",
        action="store_true",
        help="the run was made on another kind of processor, or with another torch: rounding may differ",
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    add_runs_dir(parser)
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Exit status 0 if all agrees, 1 if something differs."""
    folder = RunFolder.open(options.runs_dir, options.run_id)
    with bar("epochs trained again") as on_epoch:
        verification = Verification(folder, elsewhere=options.elsewhere, on_epoch=on_epoch)
        findings = verification.run()
    if options.json:
        print(json.dumps(_as_json(verification, findings)))
    else:
        _show(verification, findings)
    return 0 if findings.agrees else 1


def _as_json(verification: Verification, findings: Findings) -> dict[str, Any]:
    return {
        "run_id": str(verification.folder.run),
        "iterations": len(verification.records),
        "agrees": findings.agrees,
        "checks": {
            name: {
                "verdict": check.verdict,
                "compared": check.compared,
                "differences": [
                    {"where": d.where, "found": d.found, "expected": d.expected, "hint": d.hint}
                    for d in check.differences
                ],
                "notes": check.notes,
            }
            for name, check in findings.checks.items()
        },
        "trusted": what_is_trusted(verification.config),
    }


def _show(verification: Verification, findings: Findings) -> None:
    config = verification.config
    lines = [
        f"run {verification.folder.run} ({config.algorithm}, {config.task}): "
        f"{len(verification.records)} of {config.iterations} iterations"
    ]
    for name, check in findings.checks.items():
        lines.append(f"{check.verdict:<11}{name:<16}{CHECKS[name]}; {check.compared} compared")
        lines += [f"{'':<11}  {difference}" for difference in check.differences[:_SHOWN]]
        if len(check.differences) > _SHOWN:
            lines.append(f"{'':<11}  and {len(check.differences) - _SHOWN} more (--json has all)")
        lines += [f"{'':<11}  note: {note}" for note in check.notes]
    lines += [f"on trust   {text}" for text in what_is_trusted(config)]
    lines.append("all agrees" if findings.agrees else "something differs")
    Console().print("\n".join(lines), highlight=False, markup=False, soft_wrap=True)
