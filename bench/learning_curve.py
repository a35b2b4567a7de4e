"""The reaching run of the paper's Table I on several seeds: curve, table and raw numbers into docs/results.

    .venv/bin/python bench/learning_curve.py [--seeds 3] [--runs-dir runs/learning-curve]

Resumable: a seed whose run is finished is not run again, one that was interrupted goes on.
"""

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from rich.console import Console

from bpn.bench.machine import machine
from bpn.local_run import execute, new_run, private_endpoint
from bpn.summary import summarize
from bpn_robot_sim.reaching.optimum import optimal_return
from bpn_shared.config import RunConfig
from bpn_shared.run_folder import RunFolder
from bpn_shared.service import stop_on_signals

mpl.use("Agg")
from matplotlib import pyplot as plt

RESULTS = Path(__file__).parents[1] / "docs" / "results"
RANDOM_RETURN_PX = -864.0  # exact over the chain of poses, see docs/tasks/reaching.md
LAST = 5


def folder_for(runs_dir: Path, config: RunConfig) -> RunFolder:
    """The folder of this configuration's run, made if there is none."""
    for path in sorted(runs_dir.glob("*/config.json")):
        folder = RunFolder(path.parent)
        if folder.config() == config:
            return folder
    return new_run(runs_dir, config)


def plot(returns: np.ndarray[Any, np.dtype[np.float64]], optimum_px: float, path: Path) -> None:
    """Every seed's curve and their mean, between random play and the optimum."""
    figure, axes = plt.subplots(figsize=(7, 4), layout="constrained")
    iterations = np.arange(1, returns.shape[1] + 1)
    for seed, curve in enumerate(returns):
        axes.plot(iterations, curve, lw=0.9, alpha=0.55, label=f"seed {seed}")
    axes.plot(iterations, returns.mean(axis=0), lw=2, color="black", label="mean")
    axes.axhline(optimum_px, ls="--", color="tab:green", label=f"optimum {optimum_px:.0f} px")
    axes.axhline(2 * optimum_px, ls=":", color="tab:green", label="twice the optimum")
    axes.axhline(RANDOM_RETURN_PX, ls="--", color="tab:gray", label="random play")
    axes.set(
        xlabel="iteration (10 episodes of 20 steps each)",
        ylabel="return per episode (px)",
        title="BPN on reaching, Table I of the paper, training returns",
    )
    axes.legend(fontsize=8, ncols=2)
    axes.grid(alpha=0.3)
    figure.savefig(path, dpi=130)


def main() -> int:
    """Runs what is missing, then writes the results; exit status 1 if a seed misses the target."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--runs-dir", type=Path, default=Path("runs/learning-curve"))
    options = parser.parse_args()
    stop = stop_on_signals()
    summaries = []
    for seed in range(options.seeds):
        folder = folder_for(options.runs_dir, RunConfig.for_task("reaching", seed=seed))
        if folder.state().state != "finished":
            print(f"seed {seed}: run {folder.run}", file=sys.stderr)
            execute(folder, endpoint=private_endpoint(), stop=stop, out=Console(stderr=True))
            if stop.is_set():
                return 130
        summaries.append(summarize(folder))
    optimum_px = optimal_return()
    finals = [float(np.mean(summary["returns"][-LAST:])) for summary in summaries]
    RESULTS.mkdir(parents=True, exist_ok=True)
    plot(
        np.array([summary["returns"] for summary in summaries]),
        optimum_px,
        RESULTS / "reaching.png",
    )
    result = {
        "command": "bench/learning_curve.py --seeds " + str(options.seeds),
        "machine": machine(),
        "optimum_px": optimum_px,
        "final_returns_px": finals,
        "runs": summaries,
    }
    (RESULTS / "reaching.json").write_text(json.dumps(result, indent=1) + "\n")
    for seed, (final, summary) in enumerate(zip(finals, summaries, strict=True)):
        print(f"seed {seed}: last {LAST} iterations {final:.1f} px, {summary['seconds']:.0f} s")
    return 0 if min(finals) >= 2 * optimum_px else 1


if __name__ == "__main__":
    raise SystemExit(main())
