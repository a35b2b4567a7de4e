"""How many random faults in the core's RTL the tests notice: `python -m tests.rtl.mutants --sample 300 --seed 1`.

A mutant differs in one place: an operator, a constant, a condition, an assignment left out. One that does not
build is none. Each is made into a model of its own and goes through a short version of the suite: networks of
several sizes by every layer, frames with swaps while they run, refusals. Those that live are listed. Goes on
where it was.
"""

import argparse
import json
import random
import re
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path

from bpn_edge.fpga import sources

ROOT = Path(__file__).parents[2]
RULES = (
    (r"==", "!="), (r"!=", "=="), (r"&&", "||"), (r"\|\|", "&&"), (r"(?<![<>=])>=", "<"),
    (r"(?<=\w) < (?=\w)", " >= "), (r" \+ ", " - "), (r" - (?!>)", " + "), (r"\b1'b1\b", "1'b0"),
    (r"\b1'b0\b", "1'b1"), (r"'0\b", "'1"), (r"!(?=[\w(])", ""), (r"\b(\d)'d(\d)\b", None),
    (r"\bif \(", "if (!"), (r"(?<=\? )(\S+) : ([^;]+)(?=;)", r"\2 : \1"),
    (r"^(\s+)(\w[\w\[\]:.+*' -]* <= [^;]+;)$", r"\1;"),
)  # fmt: skip
"""What is changed into what; None: the constant into its neighbour."""


@dataclass(frozen=True)
class Mutant:
    file: str
    line: int
    before: str
    after: str


def mutants() -> list[Mutant]:
    """All that the rules give."""
    found = []
    for path in sources.core_files():
        for number, line in enumerate(path.read_text().splitlines(), 1):
            code = line.split("//")[0]
            if not code.strip() or re.match(
                r"\s*(module|parameter|localparam|input|output|logic|import|genvar|for|\.)", code
            ):
                continue
            for pattern, replacement in RULES:
                for match in re.finditer(pattern, code):
                    new = (
                        f"{match[1]}'d{int(match[2]) ^ 1}"
                        if replacement is None
                        else match.expand(replacement)
                    )
                    found.append(
                        Mutant(
                            path.name,
                            number,
                            line,
                            code[: match.start()] + new + code[match.end() :],
                        )
                    )
    return found


def noticed(mutant: Mutant) -> str:
    """`killed`, `lives`, or `none` where it does not build."""
    with tempfile.TemporaryDirectory() as folder:
        rtl = Path(folder) / "rtl"
        subprocess.run(["cp", "-r", sources.folder(), rtl], check=True)
        path = rtl / mutant.file
        lines = path.read_text().splitlines()
        lines[mutant.line - 1] = mutant.after
        path.write_text("\n".join((*lines, "")))
        command = [sys.executable, "-m", "tests.rtl.short_suite", str(rtl)]
        try:
            done = subprocess.run(
                command, cwd=ROOT, capture_output=True, text=True, timeout=900, check=False
            )
        except subprocess.TimeoutExpired:
            return "killed"
    return {0: "lives", 3: "none"}.get(done.returncode, "killed")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sample", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--results", type=Path, default=ROOT / "build/rtl-mutants.jsonl")
    options = parser.parse_args()
    sample = mutants()
    random.Random(options.seed).shuffle(sample)
    options.results.parent.mkdir(exist_ok=True, parents=True)
    known = (
        [json.loads(line) for line in options.results.read_text().splitlines()]
        if options.results.exists()
        else []
    )
    outcomes = {
        Mutant(**{k: v for k, v in row.items() if k != "outcome"}): row["outcome"] for row in known
    }
    with ThreadPoolExecutor(options.jobs) as pool, options.results.open("a") as results:
        for start in range(0, len(sample), options.jobs):
            if sum(outcome != "none" for outcome in outcomes.values()) >= options.sample:
                break
            batch = [
                mutant for mutant in sample[start : start + options.jobs] if mutant not in outcomes
            ]
            for mutant, outcome in zip(batch, pool.map(noticed, batch), strict=True):
                outcomes[mutant] = outcome
                results.write(json.dumps({**asdict(mutant), "outcome": outcome}) + "\n")
                results.flush()
    real = {mutant: outcome for mutant, outcome in outcomes.items() if outcome != "none"}
    for mutant, outcome in real.items():
        if outcome == "lives":
            print(
                f"{mutant.file}:{mutant.line}: {mutant.before.strip()}  ->  {mutant.after.strip()}"
            )
    killed = sum(outcome == "killed" for outcome in real.values())
    print(f"{killed} of {len(real)} mutants noticed ({killed / max(1, len(real)):.1%})")


if __name__ == "__main__":
    main()
