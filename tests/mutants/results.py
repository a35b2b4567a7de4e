"""What was found: printed, and as a document for the pages that tell of it."""

import json
import subprocess
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tests.mutants.tree import ROOT

SAMPLED_TARGET, AIMED_TARGET = 0.92, 0.90
VERDICTS = ("killed", "hung", "survived", "equivalent", "untried")
Record = dict[str, Any]


def document(aimed: Sequence[Record], sampled: Sequence[Record], **how: object) -> dict[str, Any]:
    """Counts by module and of all, what nothing noticed, and what is equivalent; `how` the sample was taken."""
    of_modules: dict[str, Counter[str]] = {}
    for record in sampled:
        of_modules.setdefault(record["module"], Counter())[record["verdict"]] += 1
    commit = _commit()
    modules = {name: _counts(of) | {"commit": commit} for name, of in of_modules.items()}
    noticed = [record for record in aimed if record["verdict"] == "noticed"]
    return {
        "how": how,
        "sampled": {
            "modules": modules,
            "total": _total(modules),
            "survivors": [record["what"] for record in sampled if record["verdict"] == "survived"],
            "equivalent": {r["what"]: r["by"] for r in sampled if r["verdict"] == "equivalent"},
        },
        "aimed": _aimed(
            {record["what"]: record["by"] for record in noticed},
            [record["what"] for record in aimed if record["verdict"] == "missed"],
            untried=sum(record["verdict"] == "untried" for record in aimed),
        ),
    }


def merged(older: dict[str, Any], newer: dict[str, Any]) -> dict[str, Any]:
    """The newer document, with the older's modules and faults that it does not have or has not tried."""
    was, now = older["sampled"], newer["sampled"]
    tried = {name for name, row in now["modules"].items() if not row["untried"]}
    modules = was["modules"] | {
        name: row
        for name, row in now["modules"].items()
        if name in tried or name not in was["modules"]
    }

    def of_the_rest(what: str) -> bool:
        return what.partition(":")[0] not in tried

    by = older["aimed"]["by"] | newer["aimed"]["by"]
    missed = {*older["aimed"]["missed"], *newer["aimed"]["missed"]} - newer["aimed"]["by"].keys()
    by = {name: what for name, what in by.items() if name not in missed}
    known = len(by) + len(missed)
    return {
        "how": newer["how"],
        "sampled": {
            "modules": modules,
            "total": _total(modules),
            "survivors": [*filter(of_the_rest, was["survivors"]), *now["survivors"]],
            "equivalent": {
                what: why for what, why in was["equivalent"].items() if of_the_rest(what)
            }
            | now["equivalent"],
        },
        "aimed": _aimed(by, sorted(missed), untried=max(0, older["aimed"]["faults"] - known)),
    }


def _total(modules: dict[str, dict[str, Any]]) -> dict[str, Any]:
    total = {verdict: sum(row[verdict] for row in modules.values()) for verdict in VERDICTS}
    counted = total["killed"] + total["hung"] + total["survived"]
    noticed = counted - total["survived"]
    return total | {
        "changes": sum(total.values()), "modules": len(modules), "counted": counted,
        "noticed": noticed, "share": _share(noticed, counted),
    }  # fmt: skip


def _aimed(by: dict[str, str], missed: list[str], *, untried: int) -> dict[str, Any]:
    tried = len(by) + len(missed)
    return {
        "faults": tried + untried, "tried": tried, "noticed": len(by),
        "by_verify": sum(what.startswith("bpn verify") for what in by.values()),
        "share": _share(len(by), tried), "missed": missed, "by": by,
    }  # fmt: skip


def show(found: dict[str, Any]) -> bool:
    """Prints it; whether both targets are reached."""
    print()
    for name, counts in found["sampled"]["modules"].items():
        told = (f"{counts[verdict]} {verdict}" for verdict in VERDICTS if counts[verdict])
        print(f"{name:<32}", ", ".join(told))
    for what in found["sampled"]["survivors"]:
        print("survived ", what)
    for what in found["aimed"]["missed"]:
        print("missed   ", what)
    reached = []
    for name, part, of, target in (
        ("sampled changes", found["sampled"]["total"], "counted", SAMPLED_TARGET),
        ("aimed faults", found["aimed"], "tried", AIMED_TARGET),
    ):
        told = f"{part['noticed']} of {part[of]} noticed, {part['share']:.1%}"
        print(f"{name}: {told} (at least {target:.0%})")
        reached.append(part["share"] >= target)
    return all(reached)


def keep(found: dict[str, Any], path: Path) -> None:
    """Writes the document; of one that is there, what was not tried this time stays."""
    if path.exists():
        found = merged(json.loads(path.read_text()), found)
    path.write_text(json.dumps(found, indent=1) + "\n")


def _counts(counts: Counter[str]) -> dict[str, int]:
    return {verdict: counts[verdict] for verdict in VERDICTS}


def _share(part: int, of: int) -> float:
    return round(part / of, 4) if of else 1.0


def _commit() -> str:
    def git(*arguments: str) -> str:
        done = subprocess.run(
            ["git", *arguments], cwd=ROOT, capture_output=True, text=True, check=True
        )
        return done.stdout.strip()

    changed = git("status", "--porcelain", "--untracked-files=no")
    return git("rev-parse", "--short", "HEAD") + (" and changes" if changed else "")
