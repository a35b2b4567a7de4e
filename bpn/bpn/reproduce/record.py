"""What a document keeps of a run: small, and enough for every curve and table."""

from typing import Any

import numpy as np

from bpn.reproduce.statistics import LAST, full_length_shares
from bpn_shared.runs.folder import RunFolder


def run_record(folder: RunFolder) -> dict[str, Any]:
    """The run's results, from its metrics.

    Returns:
        run_id, task, algorithm, hidden_units, alpha, seed, steps (T), episodes (E an iteration) and frame_skip
        (environment steps of an action, in gym: tasks); per iteration returns_px (of a gym: task returns, in its
        own unit), lengths (means over its episodes) and failures (episodes that ended before T); seconds;
        weights_sha256 of the last policy.
    """
    config, lines = folder.config(), folder.metrics()
    metric = config.task_spec.return_metric
    return {
        "run_id": str(folder.run),
        "task": config.task,
        "algorithm": config.algorithm,
        "hidden_units": config.hidden_units,
        "alpha": config.alpha,
        "seed": config.seed,
        "steps": config.steps,
        "episodes": config.episodes,
        "frame_skip": config.frame_skip,
        metric.replace("return", "returns"): [round(line[metric], 2) for line in lines],
        "lengths": [round(line["length"], 2) for line in lines],
        "failures": [
            line["terminated"] if "terminated" in line else line["failures"] for line in lines
        ],
        "seconds": round(sum(line["iteration_s"] for line in lines), 1),
        "weights_sha256": lines[-1]["weights_sha256"],
    }


def headline(folder: RunFolder) -> str:
    """A finished run in one line."""
    record = run_record(folder)
    task = folder.config().task_spec
    returns = record[task.return_metric.replace("return", "returns")][-LAST:]
    last = len(returns)
    share = np.mean(full_length_shares(record)[-last:])
    return (
        f"{record['algorithm']}  N {record['hidden_units']}  alpha {record['alpha']:g}  seed {record['seed']}"
        f"  return {np.mean(returns):8.1f}{task.return_unit}  full length {share:4.0%}"
        f"  (last {last} iterations)  {record['seconds']:.0f} s"
    )
