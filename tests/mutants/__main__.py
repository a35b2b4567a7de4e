"""`make mutants`: how many faults do the tests notice? Of a random sample, and of faults aimed at what matters.

Tools that exist were looked at first: mutmut has one test suite for all code, in its own process, where ours has
tests meant for each module and services in processes of their own; cosmic-ray edits the tree that one works in.
Neither takes faults that somebody wrote down.

What was tried is kept in build/mutants.jsonl, so that a run that was interrupted goes on.
"""

import argparse
import hashlib
import json
import os
from collections import Counter
from typing import Any

from tests.mutants.aimed import Fault, faults, noticed_by
from tests.mutants.sampled import equivalent, outcomes, sample, tests_of_modules
from tests.mutants.tree import ROOT, Tree, tree

KEPT = ROOT / "build" / "mutants.jsonl"
SAMPLED_TARGET, AIMED_TARGET = 0.92, 0.90


def main() -> int:
    parser = argparse.ArgumentParser(prog="make mutants", description=__doc__.splitlines()[0])
    parser.add_argument(
        "--sample", type=int, default=10, metavar="N", help="changes of each module"
    )
    parser.add_argument("--seed", type=int, default=0, help="of the sample")
    parser.add_argument("--only", default="", metavar="PART", help="of a file's or a fault's name")
    parser.add_argument("--anew", action="store_true", help="forget what was tried before")
    options = parser.parse_args()
    os.nice(10)
    KEPT.parent.mkdir(exist_ok=True)
    if options.anew:
        KEPT.unlink(missing_ok=True)
    known = _known()
    with tree() as copy:
        aimed = [_aimed(copy, f, known) for f in faults() if options.only in f.name + f.file]
        sampled = _sampled(copy, options, known)
    return _report(aimed, sampled)


def _known() -> dict[str, dict[str, Any]]:
    lines = KEPT.read_text().splitlines() if KEPT.exists() else []
    return {record["key"]: record for record in map(json.loads, lines)}


def _keep(record: dict[str, Any]) -> dict[str, Any]:
    with KEPT.open("a") as file:
        file.write(json.dumps(record) + "\n")
    print(f"{record['verdict']:<9} {record['what']}  {record['by']}"[:200], flush=True)
    return record


def _key(file: str, what: str, tests: tuple[str, ...] | list[str]) -> str:
    """Another one when the module or its tests have changed."""
    digest = hashlib.sha256(what.encode())
    for path in (file, *tests):
        digest.update((ROOT / path).read_bytes())
    return digest.hexdigest()


def _aimed(copy: Tree, fault: Fault, known: dict[str, dict[str, Any]]) -> dict[str, Any]:
    key = _key(fault.file, repr(fault), fault.tests)
    if key in known:
        return known[key]
    by = noticed_by(fault, copy)
    verdict = "noticed" if by else "missed"
    return _keep({"key": key, "what": fault.name, "verdict": verdict, "by": by})


def _sampled(
    copy: Tree, options: argparse.Namespace, known: dict[str, dict[str, Any]]
) -> list[dict[str, Any]]:
    excused, found = equivalent(), []
    for file, tests in tests_of_modules().items():
        if options.only not in file:
            continue
        chosen = {}
        for mutation in sample(file, options.sample, options.seed):
            what = f"{file}:{mutation.line} {mutation.function}: {mutation.change}"
            key = _key(file, what, tests)
            if (file, mutation.function, mutation.change) in excused:
                found.append({"what": what, "verdict": "equivalent", "file": file})
            elif key in known:
                found.append(known[key])
            else:
                chosen[mutation] = key, what
        for mutation, verdict, by in outcomes(copy, file, tests, list(chosen)):
            key, what = chosen[mutation]
            record = {"key": key, "what": what, "verdict": verdict, "by": by, "file": file}
            found.append(_keep(record))
    return found


def _report(aimed: list[dict[str, Any]], sampled: list[dict[str, Any]]) -> int:
    print()
    for file in dict.fromkeys(record["file"] for record in sampled):
        counts = Counter(r["verdict"] for r in sampled if r["file"] == file)
        print(f"{file:<62}", ", ".join(f"{n} {verdict}" for verdict, n in counts.most_common()))
    for record in (*sampled, *aimed):
        if record["verdict"] in ("survived", "missed"):
            print(f"{record['verdict']:<9} {record['what']}")
    counted = [r for r in sampled if r["verdict"] != "equivalent"]
    shares = []
    for name, records, good, target in (
        ("sampled changes", counted, ("killed", "timeout"), SAMPLED_TARGET),
        ("aimed faults", aimed, ("noticed",), AIMED_TARGET),
    ):
        noticed = sum(record["verdict"] in good for record in records)
        share = noticed / len(records) if records else 1.0
        print(f"{name}: {noticed} of {len(records)} noticed, {share:.1%} (at least {target:.0%})")
        shares.append(share >= target)
    return 0 if all(shares) else 1


if __name__ == "__main__":
    raise SystemExit(main())
