"""What was found: printed, and as a document for the pages that tell of it."""

import json
import subprocess
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tests.mutants.tree import ROOT

SAMPLED_TARGET, AIMED_TARGET = 0.92, 0.90
Record = dict[str, Any]


def document(aimed: Sequence[Record], sampled: Sequence[Record], **how: object) -> dict[str, Any]:
    """Counts by module and of all, what nothing noticed, and what is equivalent; `how` the sample was taken."""
    of_modules: dict[str, Counter[str]] = {}
    for record in sampled:
        of_modules.setdefault(record["module"], Counter())[record["verdict"]] += 1
    total = Counter(record["verdict"] for record in sampled)
    counted = len(sampled) - total["equivalent"] - total["untried"]
    noticed = [record for record in aimed if record["verdict"] == "noticed"]
    tried = len([record for record in aimed if record["verdict"] != "untried"])
    return {
        "commit": _commit(),
        "how": how,
        "sampled": {
            "modules": {name: _counts(counts) for name, counts in of_modules.items()},
            "total": _counts(total) | {
                "changes": len(sampled), "modules": len(of_modules), "counted": counted,
                "noticed": counted - total["survived"],
                "share": _share(counted - total["survived"], counted),
            },
            "survivors": [record["what"] for record in sampled if record["verdict"] == "survived"],
            "equivalent": {r["what"]: r["by"] for r in sampled if r["verdict"] == "equivalent"},
        },
        "aimed": {
            "faults": len(aimed), "tried": tried, "noticed": len(noticed),
            "by_verify": sum(record["by"].startswith("bpn verify") for record in noticed),
            "share": _share(len(noticed), tried),
            "missed": [record["what"] for record in aimed if record["verdict"] == "missed"],
            "by": {record["what"]: record["by"] for record in noticed},
        },
    }  # fmt: skip


def show(found: dict[str, Any]) -> bool:
    """Prints it; whether both targets are reached."""
    print()
    for name, counts in found["sampled"]["modules"].items():
        print(f"{name:<32}", ", ".join(f"{n} {verdict}" for verdict, n in counts.items() if n))
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
    """Writes the document."""
    path.write_text(json.dumps(found, indent=1) + "\n")


def _counts(counts: Counter[str]) -> dict[str, int]:
    verdicts = ("killed", "hung", "survived", "equivalent", "untried")
    return {verdict: counts[verdict] for verdict in verdicts}


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
