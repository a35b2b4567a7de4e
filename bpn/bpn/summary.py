"""What a run came to, from its folder alone: the object that `bpn train --json` prints."""

from dataclasses import dataclass, field
from statistics import median
from typing import Any

import numpy as np
import numpy.typing as npt

from bpn.stored import stored_episodes
from bpn_shared.runs.folder import RunFolder


def summarize(folder: RunFolder) -> dict[str, Any]:
    """The run's results.

    Returns:
        run_id, state, reason (why it finished before its last iteration, or failed; "" otherwise), iterations,
        episodes, transitions, episodes_lost, episodes_duplicated,
        weights_version, weights_sha256 (of the policy alone: equal policies, equal digests), returns and
        lengths (means per iteration; pixels, or of a gym: task its own unit; steps), seconds (in all iterations),
        edge.inference_us and loop.camera_to_action_us ({p50, p99} over all steps), loop.steps_per_s and
        learner.updates_per_s (medians over iterations; the first includes the start of the processes).
    """
    config, records, state = folder.config(), folder.metrics(), folder.state()
    kept = _stored(folder)
    learned_from = sum(record["episodes"] for record in records)
    stored = sum(
        (record["iteration"], episode) in kept.which
        for record in records
        for episode in range(config.episodes)
    )
    weights = folder.newest_weights() if records else None
    return {
        "run_id": str(folder.run),
        "state": state.state,
        "reason": state.error or "",
        "task": config.task,
        "algorithm": config.algorithm,
        "seed": config.seed,
        "iterations": len(records),
        "episodes": stored,
        "transitions": sum(record["transitions"] for record in records),
        "episodes_lost": len(records) * config.episodes - stored,
        "episodes_duplicated": learned_from - stored,
        "weights_version": weights.version if weights else None,
        "weights_sha256": weights.content_sha256() if weights else None,
        "returns": [round(record[config.task_spec.return_metric], 3) for record in records],
        "lengths": [round(record["length"], 3) for record in records],
        "seconds": round(sum(record["iteration_s"] for record in records), 3),
        "edge": {"inference_us": percentiles(np.concatenate(kept.inference_us))},
        "loop": {
            "camera_to_action_us": percentiles(np.concatenate(kept.loop_us)),
            "steps_per_s": _median([r["transitions"] / r["collect_s"] for r in records]),
        },
        "learner": {"updates_per_s": _median([r["updates"] / r["update_s"] for r in records])},
    }


def percentiles(values: npt.NDArray[np.float64]) -> dict[str, float | None]:
    """p50 and p99, or None where there are no values."""
    if not len(values):
        return {"p50": None, "p99": None}
    p50, p99 = np.percentile(values, [50, 99])
    return {"p50": round(float(p50), 2), "p99": round(float(p99), 2)}


def _median(values: list[float]) -> float | None:
    return round(median(values), 2) if values else None


@dataclass
class _Stored:
    """What the stored episodes tell, without their pixels; a damaged one is lost."""

    which: set[tuple[int, int]] = field(default_factory=set)
    inference_us: list[npt.NDArray[np.float64]] = field(default_factory=lambda: [np.empty(0)])
    loop_us: list[npt.NDArray[np.float64]] = field(default_factory=lambda: [np.empty(0)])


def _stored(folder: RunFolder) -> _Stored:
    stored = _Stored()
    for episode in stored_episodes(folder):
        stored.which.add((episode.meta.iteration, episode.meta.episode))
        stored.inference_us.append(episode.inference_ns / 1e3)
        in_time = episode.camera_to_action_ns > 0
        stored.loop_us.append(episode.camera_to_action_ns[in_time] / 1e3)
    return stored
