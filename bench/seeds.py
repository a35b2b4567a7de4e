"""Runs of Algorithm 1 in one process, for questions that need many seeds: the product's parts without its bus.

Equal seeds give the weights that `bpn train` gives. One line of JSON an iteration, one file a run; what is there
already is not computed again, and a run that was ended goes on where it was. One thread a run:

    python -m bench.seeds reaching --seeds 7,8,9 --set lr_run_final_factor=0.02 --out build/seeds
"""

import argparse
import copy
import json
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from bench.interrupted import State
from bpn_edge import kernel as kernels
from bpn_edge.factored import JointSelector, epsilon_of_each, joint_selector
from bpn_edge.policy import epsilon_greedy_action, softmax_action, softmax_weights
from bpn_learner.augmentation import seen_again
from bpn_learner.factory import initial_policy
from bpn_learner.networks import PNetwork
from bpn_learner.replay import ReplayMemory
from bpn_learner.reward import function_of
from bpn_learner.reward_scale import RewardScale
from bpn_learner.transitions import EpisodeData, data_of
from bpn_learner.update import UpdateConfig, policy_update
from bpn_robot.robot import Robot
from bpn_robot.robots import make_robot
from bpn_shared.bnn.outputs import Outputs
from bpn_shared.bnn.weights import Weights
from bpn_shared.camera.disturbed import EpisodeCamera
from bpn_shared.spec.algorithms import KERNELS
from bpn_shared.spec.config import RunConfig
from bpn_shared.spec.disturbances import parse
from bpn_shared.spec.joint_actions import all_parted
from bpn_shared.spec.observation import stack
from bpn_shared.spec.seeds import choice_uniforms, episode_seed, shuffle_generator

GREEDY_SEED = 2**32
"""Of greedy trials: starts that no training has."""


class Player:
    """Plays episodes with a policy, as robot and edge do in lockstep."""

    def __init__(self, config: RunConfig) -> None:
        self.config, self.task = config, config.task_spec
        self.robot: Robot = make_robot(self.task)
        self.kernel = kernels.load(KERNELS[config.algorithm_spec.network][0])
        self.entropies: list[float] = []

    def load(self, weights: Weights) -> None:
        self.kernel.load(weights)
        self.scale = weights.scale

    def play(self, seed: int, epsilon: float, *, greedy: bool = False) -> EpisodeData:
        config, robot = self.config, self.robot
        frames = [robot.reset(seed)]
        dims = self.task.dims
        uniforms = choice_uniforms(seed, config.steps, len(dims)).tolist()
        choose = self.selector(epsilon, greedy=greedy)
        actions: list[int] = []
        told: list[float] = []
        for step in range(config.steps):
            seen = stack(frames, step, self.task.frames_stacked, difference=config.difference)
            outputs = self.kernel.run(np.ascontiguousarray(seen))
            action = choose(outputs, uniforms[step])
            if not greedy and config.policy == "softmax":
                self.entropies.append(self.entropy(outputs))
            robot.command(action)
            robot.settle()
            frames.append(robot.frame())
            told.append(robot.reward())
            actions.append(action)
            if robot.terminated or robot.truncated:
                break
        pixels = np.stack(frames)
        reward = function_of(self.task)
        rewards = np.array(told) if reward is None else reward(pixels, self.task)
        choices = all_parted(np.array(actions), dims).astype(np.uint8)
        return EpisodeData(
            pixels, choices if len(dims) > 1 else choices[:, 0], rewards, robot.terminated
        )

    def selector(self, epsilon: float, *, greedy: bool) -> JointSelector:
        scale, beta, dims = self.scale, self.config.beta, self.task.dims
        if self.config.policy == "softmax" and not greedy:
            return joint_selector(lambda o, u: softmax_action(o, scale, beta, u), dims)
        share = 0.0 if greedy else epsilon_of_each(epsilon, len(dims))
        return joint_selector(lambda o, u: epsilon_greedy_action(o, share, u), dims)

    def entropy(self, outputs: Outputs) -> float:
        total = 0.0
        for own in np.split(outputs, np.cumsum(self.task.dims)[:-1]):
            pi = np.array(softmax_weights(own, self.scale, self.config.beta))
            pi /= pi.sum()
            total -= float((pi * np.log(pi + 1e-300)).sum())
        return total


def kept(config: RunConfig, weights: Weights, levels: str, trials: int) -> dict[str, Any]:
    """Greedy trials under disturbances: how many were not lost, and their mean return."""
    player = Player(config.disturbed(levels))
    player.load(weights)
    played = [player.play(GREEDY_SEED + k, 0.0, greedy=True) for k in range(trials)]
    player.robot.close()
    return {
        "disturb": levels,
        "kept": sum(len(e.actions) == config.steps for e in played),
        "trials": trials,
        "return": float(np.mean([e.rewards.sum() for e in played])),
    }


def reestimated(
    network: PNetwork, D: Sequence[EpisodeData], config: RunConfig, levels: str
) -> Weights:
    """The network with batch norm estimated anew over D, half of it disturbed; nothing is trained."""
    again = copy.deepcopy(network)
    cameras = [EpisodeCamera(parse(levels) if k % 2 else {}, k) for k in range(len(D))]
    disturbed = [
        replace(e, frames=np.stack([camera.picture(f, t) for t, f in enumerate(e.frames)]))
        for e, camera in zip(D, cameras, strict=True)
    ]
    seen = data_of(config, disturbed)
    again.finish_update(lambda: [seen.gather(seen.observations)])
    return again.export()


def iterations(
    config: RunConfig,
    trials: int,
    levels: Sequence[str],
    *,
    adapt: str,
    last_trials: int,
    state: State,
) -> Iterator[dict[str, Any]]:
    """What each iteration came to, and at the end what the policy does under disturbances."""
    for record, network, D in policies(config, trials, state):  # noqa: B007 - the last ones
        yield record
    for of_camera in levels:
        yield {"trained": True} | kept(config, network.export(), of_camera, last_trials)
    if adapt:
        adapted = reestimated(network, D, config, adapt)
        for of_camera in levels:
            yield {"adapted": True} | kept(config, adapted, of_camera, last_trials)


def policies(
    config: RunConfig, trials: int = 0, state: State | None = None
) -> Iterator[tuple[dict[str, Any], PNetwork, list[EpisodeData]]]:
    """What each iteration came to, the network that its update left, and the update's D.

    Args:
        trials: greedy episodes before every update.
        state: what it goes on from, and keeps for the next time.
    """
    network, optimizer = initial_policy(config)
    player = Player(config)
    memory = ReplayMemory(config.replay_iterations, config.replay_transitions)
    done, data_sets, found = state.load(network, optimizer) if state else (0, [], 0.0)
    reward_scale = RewardScale(config, found)
    for data_set in data_sets:
        memory.add(data_set)
    player.load(network.export())
    for i in range(done, config.iterations):
        start = time.process_time()
        player.entropies = []
        episodes = [
            player.play(episode_seed(config.seed, i, e), config.epsilon(i))
            for e in range(config.episodes)
        ]
        greedy = [player.play(GREEDY_SEED + k, 0.0, greedy=True) for k in range(trials)]
        memory.add(episodes)
        newest = memory.episodes
        D = data_of(config, newest, reward_scale.of(newest))
        again = None
        if augmented := parse(config.augment):
            again = data_of(config, seen_again(newest, augmented, config.seed, i))
        report = policy_update(
            network, optimizer, D, UpdateConfig.of_iteration(config, i),
            shuffle_generator(config.seed, i), again=again,
        )  # fmt: skip
        weights = network.export()
        player.load(weights)
        record = {
            "iteration": i,
            "return": float(np.mean([e.rewards.sum() for e in episodes])),
            "length": float(np.mean([len(e.actions) for e in episodes])),
            "greedy": [round(float(e.rewards.sum()), 2) for e in greedy],
            "greedy_last": [round(float(e.rewards[-1]), 2) for e in greedy],
            "greedy_actions": greedy[0].actions.tolist() if greedy else [],
            "entropy": float(np.mean(player.entropies)) if player.entropies else 0.0,
            "distinct": len({f.tobytes() for e in episodes for f in e.frames}),
            "loss_first": report.loss_first,
            "loss": report.loss_last,
            "max_preference": report.max_preference,
            "scale": report.scale,
            "saturation": report.saturation,
            "sha256": weights.content_sha256()[:16],
            "cpu_s": round(time.process_time() - start, 2),
        }
        yield record, network, newest
        if state and i + 1 < config.iterations:
            remembered = len(newest) // config.episodes
            state.save(
                i + 1, network, optimizer, episodes,
                remembered=remembered, reward_scale=reward_scale.found,
            )  # fmt: skip


def _is_before(line: str, record: dict[str, Any]) -> bool:
    """Of an earlier attempt's lines, that it is of an iteration which is not made again."""
    try:
        return bool(json.loads(line)["iteration"] < record["iteration"])
    except (ValueError, KeyError):  # cut off, or of what the policy did at the end
        return False


def value(text: str) -> Any:
    try:
        return json.loads(text)
    except json.JSONDecodeError:
        return text


def main(arguments: Sequence[str] | None = None) -> None:
    """Makes the runs that are missing."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("task")
    parser.add_argument("--seeds", default="0")
    parser.add_argument("--set", nargs="*", default=[], metavar="NAME=VALUE")
    parser.add_argument("--trials", type=int, default=1, help="greedy ones, every iteration")
    parser.add_argument(
        "--levels", nargs="*", default=[], help="disturbances to play under at the end"
    )
    parser.add_argument("--adapt", default="", help="disturbances to re-estimate batch norm under")
    parser.add_argument("--last-trials", type=int, default=20)
    parser.add_argument("--name", default="", help="of the setting; default: what is set")
    parser.add_argument("--out", type=Path, default=Path("build/seeds"))
    given = parser.parse_args(arguments)
    changes = dict(pair.split("=", 1) for pair in given.set)
    name = given.name or ",".join(given.set) or "preset"
    given.out.mkdir(parents=True, exist_ok=True)
    for seed in map(int, given.seeds.split(",")):
        path = given.out / f"{given.task.replace(':', '_')}-{name}-s{seed}.jsonl"
        if path.exists():
            continue
        config = RunConfig.for_task(
            given.task, seed=seed, **{k: value(v) for k, v in changes.items()}
        )
        part, state = path.with_suffix(".part"), State(path.with_suffix(".state"))
        told = part.read_text().splitlines(keepends=True) if part.exists() else []
        with part.open("w") as lines:
            for record in iterations(
                config, given.trials, given.levels,
                adapt=given.adapt, last_trials=given.last_trials, state=state,
            ):  # fmt: skip
                lines.writelines(line for line in told if _is_before(line, record))
                told = []
                lines.write(json.dumps(record) + "\n")
                lines.flush()
        part.rename(path)
        state.forget()
        lines_of = [json.loads(line) for line in path.read_text().splitlines()]
        returns = [line["return"] for line in lines_of if "iteration" in line]
        print(
            f"{path.stem}: last ten {np.mean(returns[-10:]):.1f}, best {max(returns):.1f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
