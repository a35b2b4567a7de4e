"""The records of an iteration, metrics and rewards, compared with its episodes."""

from typing import Any

import numpy as np

from bpn.verify.findings import Findings
from bpn.verify.recorded import epsilon
from bpn.verify.targets import Played
from bpn_shared.spec.config import RunConfig
from bpn_shared.spec.markers import REACHING_TARGET_RADIUS_PX

REWARD_TOLERANCE_PX = 6e-4
"""rewards.jsonl has three decimals."""
TOLERANCE = 1e-6
"""Of sums and means in float64, relative."""


def check_metrics(
    config: RunConfig, record: dict[str, Any], data: list[Played], findings: Findings
) -> None:
    """What the iteration's metrics say of its episodes."""
    iteration = record["iteration"]
    returns = [float(episode.rewards.sum()) for episode in data]
    lengths = [len(episode.actions) for episode in data]
    name = config.task_spec.return_metric
    expected = {
        "episodes": len(data),
        "transitions": sum(lengths),
        "length": float(np.mean(lengths)),
        "deadline_misses": sum(episode.misses for episode in data),
        # what versions before 0.2 called it
        "failures" if "failures" in record else "terminated": sum(e.terminal for e in data),
        name: float(np.mean(returns)),
    }
    successes = _successes(config, data)
    if successes is not None and "failures" not in record:
        expected["successes"] = successes
    for key, value in expected.items():
        where = f"iteration {iteration}, {key}"
        findings.compare("returns", where, record.get(key), value, tolerance=TOLERANCE)
    many = name.replace("return", "returns")
    found = np.array(record.get(many, []), np.float64)
    near = found.shape == (len(returns),) and np.allclose(found, returns, rtol=TOLERANCE)
    said = returns if near else found.tolist()
    findings.compare("returns", f"iteration {iteration}, {many}", said, returns)
    share = epsilon(config, iteration)
    where = f"iteration {iteration}"
    findings.compare("epsilon", where, record.get("epsilon"), share, tolerance=TOLERANCE)


def _successes(config: RunConfig, data: list[Played]) -> int | None:
    """Episodes that did what the task is about, where their pixels tell; else None."""
    match config.task_spec.success:
        case "kept":
            return sum(not episode.terminal for episode in data)
        case "reached":
            return sum(float(e.rewards[-1]) >= -REACHING_TARGET_RADIUS_PX for e in data)
    return None


def check_rewards(
    iteration: int, told: list[list[float]] | None, data: list[Played], findings: Findings
) -> None:
    """The rewards of every step as the learner wrote them down."""
    if told is None:
        findings.compare("rewards", f"iteration {iteration}", "no line in rewards.jsonl", "one")
        return
    for index, episode in enumerate(data):
        found = np.array(told[index] if index < len(told) else [], np.float64)
        expected = episode.rewards.numpy()
        where = f"episode ({iteration}, {index})"
        if found.shape != expected.shape:
            findings.compare("rewards", where, f"{len(found)} rewards", f"{len(expected)}")
            continue
        findings["rewards"].compared += len(expected) - 1
        gap = np.abs(found - expected)
        step = int(gap.argmax())
        right = float(expected[step])
        said = right if gap[step] <= REWARD_TOLERANCE_PX else float(found[step])
        findings.compare("rewards", f"{where}, step {step}", said, right)
