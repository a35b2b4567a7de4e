"""What a document keeps of a run: small, and enough for every curve and table."""

from typing import Any

import numpy as np

from bpn.reproduce.statistics import LAST, full_length_shares
from bpn_shared.run_folder import RunFolder


def run_record(folder: RunFolder) -> dict[str, Any]:
    """The run's results, from its metrics.

    Returns:
        run_id, task, algorithm, nodes, alpha, seed, steps (T) and episodes (E an iteration); per iteration
        returns_px, lengths (means over its episodes) and failures (episodes that ended before T);
        seconds; weights_sha256 of the last policy.
    """
    config, lines = folder.config(), folder.metrics()
    return {
        "run_id": str(folder.run),
        "task": config.task,
        "algorithm": config.algorithm,
        "nodes": config.nodes,
        "alpha": config.alpha,
        "seed": config.seed,
        "steps": config.steps,
        "episodes": config.episodes,
        "returns_px": [round(line["return_px"], 2) for line in lines],
        "lengths": [round(line["length"], 2) for line in lines],
        "failures": [line["failures"] for line in lines],
        "seconds": round(sum(line["iteration_s"] for line in lines), 1),
        "weights_sha256": lines[-1]["weights_sha256"],
    }


def headline(folder: RunFolder) -> str:
    """A finished run in one line."""
    record = run_record(folder)
    last = min(LAST, len(record["returns_px"]))
    share = np.mean(full_length_shares(record)[-last:])
    return (
        f"{record['algorithm']}  N {record['nodes']}  alpha {record['alpha']:g}  seed {record['seed']}"
        f"  return {np.mean(record['returns_px'][-last:]):8.1f} px  full length {share:4.0%}"
        f"  (last {last} iterations)  {record['seconds']:.0f} s"
    )
