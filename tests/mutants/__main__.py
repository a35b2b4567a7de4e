"""`make mutants`: how many faults do the tests notice? Of a random sample, and of faults aimed at what matters.

Tools that exist were looked at first: mutmut has one test suite for all code, in its own process, where ours has
tests meant for each module and services in processes of their own; cosmic-ray edits the tree that one works in.
Neither takes faults that somebody wrote down.

Several modules and faults are tried beside each other, each in a copy of the code of its own. What was
tried is kept in build/mutants.jsonl, so that a run that was interrupted goes on.
"""

import argparse
import hashlib
import json
import os
import threading
from collections.abc import Iterable
from functools import partial
from pathlib import Path
from typing import Any

from tests.mutants import results
from tests.mutants.aimed import Fault, faults, noticed_by
from tests.mutants.copies import copies
from tests.mutants.modules import Module, modules
from tests.mutants.sampled import SuiteFailsError, equivalent, outcomes, sample
from tests.mutants.tree import ROOT, Tree

KEPT = ROOT / "build" / "mutants.jsonl"
KINDS = ("sampled", "aimed")
Record = dict[str, Any]
_writing = threading.Lock()


def main() -> int:
    parser = argparse.ArgumentParser(prog="make mutants", description=__doc__.splitlines()[0])
    parser.add_argument(
        "--sample",
        type=int,
        default=10,
        metavar="N",
        help="changes of each module, times its share",
    )
    parser.add_argument("--seed", type=int, default=0, help="of the sample")
    parser.add_argument(
        "--only", default="", metavar="PART", help="of a module's or a fault's name"
    )
    parser.add_argument("--kind", choices=KINDS, help="only these")
    parser.add_argument(
        "--jobs",
        type=int,
        default=2,
        metavar="N",
        help="modules and faults tried beside each other",
    )
    parser.add_argument("--tried", action="store_true", help="try nothing: report what was tried")
    parser.add_argument("--anew", action="store_true", help="forget what was tried before")
    parser.add_argument(
        "--results",
        type=Path,
        metavar="FILE",
        help="write what was found, as JSON, to what is there",
    )
    options = parser.parse_args()
    os.nice(10)
    KEPT.parent.mkdir(exist_ok=True)
    if options.anew:
        KEPT.unlink(missing_ok=True)
    known = _known()
    aimed: list[Record] = []
    sampled: list[Record] = []
    with copies(options.jobs) as of_code:
        if options.kind != "aimed":
            chosen = [module for module in modules().values() if options.only in module.name]
            for records in of_code.try_each(partial(_sampled, options, known), chosen):
                sampled += records
        if options.kind != "sampled":
            wanted = [fault for fault in faults() if options.only in fault.name + fault.file]
            aimed += of_code.try_each(partial(_aimed, options, known), wanted)
    found = results.document(aimed, sampled, sample=options.sample, seed=options.seed)
    if options.results:
        results.keep(found, options.results)
    return 0 if results.show(found) else 1


def _known() -> dict[str, Record]:
    lines = KEPT.read_text().splitlines() if KEPT.exists() else []
    return {record["key"]: record for record in map(json.loads, lines)}


def _keep(record: Record) -> Record:
    with _writing, KEPT.open("a") as file:
        file.write(json.dumps(record) + "\n")
        print(f"{record['verdict']:<9} {record['what']}  {record['by']}"[:240], flush=True)
    return record


def _key(copy: Tree, file: str, what: str, tests: Iterable[str]) -> str:
    """Another one when the module or its tests have changed."""
    digest = hashlib.sha256(what.encode())
    for path in (file, *tests):
        digest.update((copy.path / path).read_bytes())
    return digest.hexdigest()


def _aimed(
    options: argparse.Namespace, known: dict[str, Record], copy: Tree, fault: Fault
) -> Record:
    key = _key(copy, fault.file, repr(fault), fault.tests)
    if key in known:
        return known[key]
    if options.tried:
        return {"what": fault.name, "verdict": "untried", "by": ""}
    try:
        by = noticed_by(fault, copy)
    except SuiteFailsError as error:
        print(error, flush=True)
        return {"what": fault.name, "verdict": "untried", "by": ""}
    verdict = "noticed" if by else "missed"
    return _keep({"key": key, "what": fault.name, "verdict": verdict, "by": by})


def _sampled(
    options: argparse.Namespace, known: dict[str, Record], copy: Tree, module: Module
) -> list[Record]:
    excused, found = equivalent(), []
    chosen = {}
    count = options.sample * module.share
    for mutation in sample(copy.path / module.file, count, options.seed):
        what = f"{module.name}:{mutation.line} {mutation.function}: {mutation.change}"
        key = _key(copy, module.file, what, module.tests)
        reason = excused.get((module.name, mutation.function, mutation.change))
        if reason is not None:
            verdict = {"verdict": "equivalent", "by": reason}
            found.append({"what": what, "module": module.name} | verdict)
        elif key in known:
            found.append(known[key])
        elif options.tried:
            found.append(_untried(what, module))
        else:
            chosen[mutation] = key, what
    try:
        for mutation, verdict, by in outcomes(copy, module, list(chosen)):
            key, what = chosen.pop(mutation)
            record = {"key": key, "what": what, "module": module.name, "verdict": verdict, "by": by}
            found.append(_keep(record))
    except SuiteFailsError as error:  # the other modules can be tried all the same
        print(error, flush=True)
    return found + [_untried(what, module) for _, what in chosen.values()]


def _untried(what: str, module: Module) -> Record:
    return {"what": what, "module": module.name, "verdict": "untried", "by": ""}


if __name__ == "__main__":
    raise SystemExit(main())
