"""The result of an evaluation as lines for people."""

from typing import Any

from bpn_shared.spec.config import RunConfig


def shown(result: dict[str, Any], config: RunConfig) -> list[str]:
    """What `bpn eval` prints of the result that its `--json` has."""
    task = config.task_spec
    per_step = result["px_per_step" if task.reward_unit == "px" else "return_per_step"]["mean"]
    tracked, time = result.get("tracking_time"), ""
    if tracked is not None:
        time = f" = {tracked['seconds']:.1f} s ({tracked['percent']:.0f} %)"
    share = result["success_share"]
    success = "n/a" if share is None else f"{100 * share:.0f} %"
    lines = [
        f"{result['trials']} {result['policy']} trials in {result['pacing']}, weights version "
        f"{result['weights_version']} of run {result['run_id']} ({config.algorithm}, {config.task})",
        f"return   {_spread(result[task.return_metric])}{task.return_unit}"
        f"   ({per_step:.1f}{task.return_unit} a step)",
        f"length   {_spread(result['length'])} of {config.steps} steps{time}",
        f"success  {success:>10}",
    ]
    if result["trials"] > 1 and result["distinct_trials"] == 1:
        lines.append("1 start: all trials are the same one, so there is nothing to spread")
    if result["policy"] == "softmax" and config.policy != "softmax":
        lines.append(
            f"softmax is not how {config.algorithm} trains: it takes the best action, or any by chance"
        )
    if result["pacing"] == "realtime":
        lines.append(f"control periods without an action: {result['deadline_misses']}")
    return lines


def _spread(value: dict[str, float | None]) -> str:
    std = value["std"]
    return f"{value['mean']:8.1f} ± {'-' if std is None else f'{std:.1f}'}"
