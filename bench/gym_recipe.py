"""The preset of `gym:` tasks on tasks that it was not made for, beside Stable-Baselines3's DQN on the same frames.

Both see what `GymRobot` shows, stacked alike, for as many of the environment's actions, and are then played
greedily from the same twenty starts. Runs that are there are not made again; the table is made of those that are:

    make bench-gym GYM="--tasks catch --seeds 0,1,2,3,4"
"""

import argparse
import importlib
import json
import os
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium
import numpy as np
import numpy.typing as npt
from gymnasium.spaces import Box, Discrete

from bench import seeds as product
from bpn_robot.robots import make_robot
from bpn_shared.spec.config import RunConfig
from bpn_shared.spec.observation import stack

Picture = npt.NDArray[np.uint8]
Play = Callable[[Picture], int]


class Task(NamedTuple):
    """An environment, how many of its actions are learned from, and what differs from the preset: frames alone."""

    name: str
    module: str
    actions: int
    budget: int
    options: dict[str, Any]


TASKS = {
    "catch": Task("gym:bench.gym_catch:Catch-v0", "bench.gym_catch", 3, 6_000, {}),
    "minigrid": Task(
        "gym:minigrid:MiniGrid-Empty-5x5-v0", "minigrid", 7, 10_000, {"frame_channels": 3}
    ),
    "breakout": Task("gym:minatar.gym:MinAtar/Breakout-v1", "minatar", 3, 20_000, {}),
    "flappybird": Task("gym:flappy_bird_gymnasium:FlappyBird-v0", "flappy_bird_gymnasium", 2, 20_000, {}),
    "freeway": Task(
        "gym:ale_py:ALE/Freeway-v5", "ale_py", 3, 20_000, {"frame_skip": 4, "difference": True}
    ),
    "cartpole": Task(
        "gym:CartPole-v1", "", 2, 20_000, {"difference": True, "frame_skip": 3, "crop": "100,120,400,200"}
    ),
}  # fmt: skip
CHOSEN_ON = ("catch",)
"""The tasks on which the preset was found; the others verify it."""
TRIALS, START_SEED = 20, product.GREEDY_SEED


class Seen(gymnasium.Env[Picture, np.int64]):
    """What a policy sees of the task, as an environment for somebody else's algorithm."""

    def __init__(self, config: RunConfig) -> None:
        self._config, self._robot = config, make_robot(config.task_spec)
        shape = config.network.observation_shape
        self.observation_space = Box(0, 255, shape, np.uint8)
        self.action_space = Discrete(config.actions)
        self._frames: list[Picture] = []

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Picture, dict[str, Any]]:
        """An episode; without a seed any."""
        super().reset(seed=seed, options=options)
        start = int(self.np_random.integers(2**32)) if seed is None else seed
        self._frames = [self._robot.reset(start)]
        return self._observation(), {}

    def step(self, action: np.int64) -> tuple[Picture, float, bool, bool, dict[str, Any]]:
        """An action of the task; the end of its T steps is a truncation."""
        robot = self._robot
        robot.command(int(action))
        robot.settle()
        self._frames.append(robot.frame())
        cut = robot.truncated or len(self._frames) > self._config.steps
        return self._observation(), robot.reward(), robot.terminated, cut, {}

    def close(self) -> None:
        self._robot.close()

    def _observation(self) -> Picture:
        stacked, difference = self._config.task_spec.frames_stacked, self._config.difference
        seen = stack(self._frames, len(self._frames) - 1, stacked, difference=difference)
        return np.ascontiguousarray(seen)


def config_of(task: Task, seed: int, **changes: Any) -> RunConfig:
    """The preset of a task that nobody tuned, whatever the task; it ends by its number of actions."""
    untuned = RunConfig.for_task("gym:Untuned-v0", actions=2).model_dump(
        include=set(RunConfig.model_fields) - {"task", "task_spec", "algorithm", "algorithm_spec"}
    )
    recipe = untuned | {"actions": task.actions, "seed": seed} | task.options | changes
    return RunConfig.bare(task.name, **recipe)


def trials(config: RunConfig, act: Play) -> list[float]:
    """Returns of greedy episodes from the same starts for all."""
    env, returns = Seen(config), []
    for trial in range(TRIALS):
        (seen, _), total, ended = env.reset(seed=START_SEED + trial), 0.0, False
        while not ended:
            seen, reward, terminated, truncated, _ = env.step(np.int64(act(seen)))
            total, ended = total + reward, terminated or truncated
        returns.append(total)
    env.close()
    return returns


def bpn(task: Task, seed: int) -> dict[str, Any]:
    """The product's parts in this process, to the last whole iteration within the budget."""
    config = config_of(task, seed)
    done, policy = 0, None
    for record, network, _ in product.policies(config):
        length = int(record["length"] * config.episodes)
        if done + length > task.budget and policy is not None:
            break
        done, policy = done + length, network.export()
    assert policy is not None
    player = product.Player(config)
    player.load(policy)
    returns = trials(config, lambda seen: int(np.argmax(player.kernel.run(seen))))
    return {"actions": done, "returns": returns}


def dqn(task: Task, seed: int) -> dict[str, Any]:
    """Stable-Baselines3's, its defaults but for what they ask of a million steps."""
    learner = importlib.import_module("stable_baselines3").DQN
    env = Seen(config := config_of(task, seed))
    model = learner(
        "CnnPolicy", env, seed=seed, buffer_size=20_000, learning_starts=500, target_update_interval=500,
        exploration_fraction=0.4, device="cpu",
    )  # fmt: skip
    model.learn(task.budget)
    env.close()
    returns = trials(config, lambda seen: int(model.predict(seen, deterministic=True)[0]))
    return {"actions": task.budget, "returns": returns}


def at_random(task: Task, seed: int) -> dict[str, Any]:
    """Any action, for comparison."""
    rng = np.random.default_rng(seed)
    returns = trials(config_of(task, seed), lambda _: int(rng.integers(task.actions)))
    return {"actions": 0, "returns": returns}


AGENTS: dict[str, Callable[[Task, int], dict[str, Any]]] = {
    "random": at_random,
    "bpn": bpn,
    "dqn": dqn,
}


def missing(
    out: Path, tasks: Sequence[str], agents: Sequence[str], seeds: Sequence[int]
) -> Iterator[tuple[Path, str, str, int]]:
    """The runs that are not there, the first seed of all tasks before the second."""
    for seed in seeds:
        for task in tasks:
            for agent in agents:
                path = out / f"{task}-{agent}-{seed}.json"
                if not path.exists():
                    yield path, task, agent, seed


def table(out: Path) -> str:
    """Markdown of the runs that are there: mean greedy return of each agent, seed by seed."""
    lines = ["| task | actions | " + " | ".join(AGENTS) + " | seeds | of what DQN gained |"]
    lines.append("| --- | ---: |" + " ---: |" * (len(AGENTS) + 2))
    for name, task in TASKS.items():
        found = {
            agent: [
                float(np.mean(json.loads(path.read_text())["returns"]))
                for path in sorted(out.glob(f"{name}-{agent}-*.json"))
            ]
            for agent in AGENTS
        }
        if not all(found.values()):
            continue
        random, mine, theirs = (float(np.mean(of)) for of in found.values())
        gained = f"{100 * (mine - random) / (theirs - random):.0f} %" if theirs > random else ""
        cells = [f"{np.mean(of):.2f} ({min(of):.2f} to {max(of):.2f})" for of in found.values()]
        chosen = " (chosen on)" if name in CHOSEN_ON else ""
        counts = "/".join(str(len(of)) for of in found.values())
        lines.append(
            f"| {name}{chosen} | {task.budget:,} | {' | '.join(cells)} | {counts} | {gained} |"
        )
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> None:
    """Makes the runs that are missing, and prints the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--tasks", default=",".join(TASKS))
    parser.add_argument("--agents", default=",".join(AGENTS))
    parser.add_argument("--seeds", default="0,1,2,3,4")
    parser.add_argument("--out", type=Path, default=Path("build/gym"))
    given = parser.parse_args(arguments)
    os.environ["BPN_GYM_MODULES"] = ",".join(filter(None, (task.module for task in TASKS.values())))
    given.out.mkdir(parents=True, exist_ok=True)
    seeds = [int(word) for word in given.seeds.split(",")]
    for path, task, agent, seed in missing(
        given.out, given.tasks.split(","), given.agents.split(","), seeds
    ):
        result = AGENTS[agent](TASKS[task], seed)
        path.write_text(json.dumps(result | {"task": task, "agent": agent, "seed": seed}) + "\n")
        print(f"{path.stem}: {np.mean(result['returns']):.2f}", flush=True)
    print(table(given.out))


if __name__ == "__main__":
    main()
