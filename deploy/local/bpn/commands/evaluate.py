"""`bpn eval`: plays a run's policy in its simulated robot and reports returns."""

import argparse
import json
from typing import Any, get_args

import numpy as np
from rich.console import Console

from bpn.options import add_runs_dir
from bpn_edge.kernel import load
from bpn_edge.policy import epsilon_greedy_action, softmax_action
from bpn_learner.reward import rewards
from bpn_robot_sim.robot import Robot, make_robot
from bpn_shared.config import ConfigError, Kernel, RunConfig
from bpn_shared.observation import stack
from bpn_shared.policies import Policy, decode_policy
from bpn_shared.run_folder import RunFolder
from bpn_shared.seeds import action_uniform, episode_seed

_EVALUATION = 2**31  # stands where training has the iteration, so seeds are disjoint


def add(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    parser = subparsers.add_parser("eval", help="play a trained policy", description=__doc__)
    parser.add_argument("run_id", metavar="RUN", help="id of the run, or its beginning or end")
    parser.add_argument("--trials", type=int, default=10, help="episodes (default 10)")
    parser.add_argument("--policy", choices=("greedy", "softmax"), default="greedy")
    parser.add_argument("--version", type=int, help="weights version (default: the newest)")
    parser.add_argument("--kernel", choices=get_args(Kernel), help="default: the run's")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    add_runs_dir(parser)
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Plays the trials and prints their returns in pixels."""
    folder = RunFolder.open(options.runs_dir, options.run_id)
    config = folder.config()
    weights = _weights(folder, options.version)
    if options.trials < 1:
        raise ConfigError(f"--trials = {options.trials} must be at least 1")
    kernel = options.kernel or config.kernel
    robot = make_robot(config.task)
    returns_px, lengths = [], []
    for trial in range(options.trials):
        frames = play(robot, weights, config, trial, policy=options.policy, kernel=kernel)
        returns_px.append(float(rewards(config.task, frames).sum()))
        lengths.append(len(frames) - 1)
    robot.close()
    result: dict[str, Any] = {
        "run_id": str(folder.run),
        "weights_version": weights.version,
        "policy": options.policy,
        "trials": options.trials,
        "return_px": {"mean": float(np.mean(returns_px)), "std": float(np.std(returns_px))},
        "returns_px": returns_px,
        "lengths": lengths,
    }
    if options.json:
        print(json.dumps(result))
    else:
        Console().print(
            f"{options.trials} {options.policy} episodes with weights version {weights.version}: return "
            f"{result['return_px']['mean']:.1f} ± {result['return_px']['std']:.1f} px, "
            f"length {np.mean(lengths):.1f}",
            highlight=False,
        )
    return 0


def play(
    robot: Robot, weights: Policy, config: RunConfig, trial: int, *, policy: str, kernel: Kernel
) -> np.typing.NDArray[np.uint8]:
    """One episode in lockstep, in this process.

    Returns:
        Its frames, uint8[T+1, c, 84, 84].
    """
    running = load(kernel)
    running.load(weights)
    seed = episode_seed(config.seed, _EVALUATION, trial)
    frames = [robot.reset(seed)]
    for step in range(config.steps):
        observation = stack(frames, step, config.task_spec.frames_stacked)
        outputs = running.run(observation)
        uniform = action_uniform(seed, step)
        if policy == "greedy":
            action = epsilon_greedy_action(outputs, 0.0, uniform)
        else:
            action = softmax_action(outputs, weights.scale, config.beta, uniform)
        robot.command(action)
        robot.settle()
        frames.append(robot.frame())
        if robot.terminated:
            break
    return np.stack(frames)


def _weights(folder: RunFolder, version: int | None) -> Policy:
    if version is None:
        return folder.newest_weights()
    path = folder.weights_path(version)
    if not path.exists():
        raise ConfigError(
            f"--version {version}: not in {path.parent}, the newest is {folder.newest_weights().version}"
        )
    return decode_policy(path.read_bytes())
