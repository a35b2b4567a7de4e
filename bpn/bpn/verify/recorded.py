"""Episodes as a run folder has them, compared with what the robot's side should have done."""

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from math import ceil

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from bpn.verify import draws, pixels
from bpn.verify.findings import Findings
from bpn.verify.play import (
    Policy,
    greedy_choice,
    inverse_temperature,
    observations,
    parts,
    softmax_choice,
)
from bpn.verify.targets import Played
from bpn_shared.messages.base import MessageError
from bpn_shared.messages.episode import Episode
from bpn_shared.runs.folder import RunFolder
from bpn_shared.spec.algorithms import EPSILON_GREEDY, SOFTMAX
from bpn_shared.spec.config import RunConfig

FLOAT_TOLERANCE = 1e-4
"""Of float outputs, relative to the largest |P|: another order of summation."""

Act = Callable[[npt.NDArray[np.float64], float], set[int]]
"""From one dimension's outputs and a uniform number to choices."""
Choices = tuple[int, ...]
"""An action, by its choice in each dimension."""


@dataclass(frozen=True, eq=False)
class Recording:
    """An episode in its place, and the policy that it should be of."""

    config: RunConfig
    policy: Policy
    iteration: int
    index: int
    episode: Episode

    @property
    def where(self) -> str:
        return f"episode ({self.iteration}, {self.index})"

    @property
    def terminal(self) -> bool:
        """Whether the task ended it."""
        return self.episode.meta.terminated

    def rewards(self) -> npt.NDArray[np.float64]:
        """float64[T]: from the pixels, or as the robot told them where the task says so.

        Raises:
            PixelError: a frame shows no marker.
        """
        if self.config.task_spec.told_rewards:
            return self.episode.rewards.copy()
        return pixels.rewards_of(self.config.task_spec, self.episode.frames)

    @property
    def dims(self) -> tuple[int, ...]:
        """Choices of each dimension of its actions."""
        return self.config.task_spec.action_dims or (self.config.task_spec.actions,)

    def actions(self) -> list[Choices]:
        """What was done in every step."""
        return [tuple(row) for row in self.episode.actions.reshape(self.episode.steps, -1).tolist()]

    def choice(self, step: int, uniforms: list[float]) -> list[set[int]]:
        """What the run's policy does on the outputs that the edge recorded, in each dimension."""
        P = self.episode.outputs[step].astype(np.float64) * self.policy.scale
        beta, share = inverse_temperature(self.config, self.iteration), epsilon_of_each(self)
        return [
            softmax_choice(own, beta, uniform)
            if self.config.policy == SOFTMAX
            else greedy_choice(own, share, uniform)
            for own, uniform in zip(parts(P, self.dims), uniforms, strict=True)
        ]


def epsilon(config: RunConfig, iteration: int) -> float:
    """Share of random actions: falls on a line over the first half of the run; 0 of a softmax policy."""
    if not config.algorithm_spec.explores:
        return 0.0
    progress = min(1.0, iteration / (config.iterations / 2))
    return config.epsilon_initial + progress * (config.epsilon_final - config.epsilon_initial)


def epsilon_of_each(recording: Recording) -> float:
    """The same of one dimension's choices: together they leave as many actions greedy as the share says."""
    share, D = epsilon(recording.config, recording.iteration), len(recording.dims)
    return share if D == 1 else 1 - (1 - share) ** (1 / D)


def played(
    folder: RunFolder, config: RunConfig, iteration: int, policy: Policy, findings: Findings
) -> list[Played] | None:
    """An iteration's episodes as data, each one checked; None if one is missing or unreadable."""
    found: list[Played] = []
    for index in range(config.episodes):
        name = f"episodes/{folder.episode_path(iteration, index).name}"
        if not folder.has(name):
            continue
        try:
            episode = Episode.decode(folder.read_file(name), config.task_spec)
            found.append(checked(Recording(config, policy, iteration, index, episode), findings))
        except (MessageError, pixels.PixelError) as error:
            where = f"episode ({iteration}, {index})"
            findings.compare("files", where, str(error), "an episode of the task")
    return found if len(found) == config.episodes else None


def checked(recording: Recording, findings: Findings) -> Played:
    """One episode as data.

    Raises:
        PixelError: a frame shows no marker.
    """
    episode, stacked = recording.episode, recording.config.task_spec.frames_stacked
    frames = torch.from_numpy(episode.frames.copy())
    observed = observations(frames, stacked, difference=recording.config.difference)
    check_meta(recording, findings)
    check_outputs(recording, observed, findings)
    check_actions(recording, findings)
    actions = torch.tensor(recording.actions(), dtype=torch.int64)
    rewards = torch.from_numpy(recording.rewards())
    return Played(observed, actions, rewards, recording.terminal, episode.meta.deadline_misses)


def check_meta(recording: Recording, findings: Findings) -> None:
    """That it is the episode of that place."""
    config, meta, where = recording.config, recording.episode.meta, recording.where
    place = recording.iteration, recording.index
    findings.compare("seeds", where, (meta.iteration, meta.episode), place)
    seed = draws.episode_seed(config.seed, *place)
    findings.compare("seeds", f"{where}, seed", meta.seed, seed)
    findings.compare("seeds", f"{where}, weights version", meta.weights_version, place[0])
    may_be_short = recording.terminal or config.task_spec.told_rewards
    if not (may_be_short and recording.episode.steps < config.steps):
        findings.compare("seeds", f"{where}, steps", recording.episode.steps, config.steps)


def check_outputs(recording: Recording, observed: Tensor, findings: Findings) -> None:
    """Integers exactly; P of a float network within rounding."""
    expected, found = recording.policy.outputs(observed[:-1]).numpy(), recording.episode.outputs
    gap = np.abs(found - expected).max(axis=1)
    size = max(1.0, float(np.abs(expected).max()))
    allowed = 0.0 if recording.policy.binary else FLOAT_TOLERANCE * size
    findings["outputs"].compared += len(gap) - 1
    step = int(gap.argmax())
    where = f"{recording.where}, step {step}"
    if gap[step] <= allowed:
        findings.compare("outputs", where, True, True)
    else:
        findings.compare("outputs", where, found[step].tolist(), expected[step].tolist())


def check_actions(recording: Recording, findings: Findings) -> None:
    """The action of every step; where none came in time (realtime pacing), the hold action."""
    episode, config = recording.episode, recording.config
    if config.policy not in (SOFTMAX, EPSILON_GREEDY):
        findings["actions"].note(
            f"the action selection {config.policy!r} is no part of this program"
        )
        return
    uniforms = draws.step_uniforms(episode.meta.seed, episode.steps, len(recording.dims))
    answers = [recording.choice(step, numbers) for step, numbers in enumerate(uniforms)]
    hold = [{choice} for choice in held(config.task_spec.hold_action, recording.dims)]
    choices = [
        [answers[frame] for frame in frames] or [hold]
        for frames in (answered(recording, step) for step in range(episode.steps))
    ]
    actions = recording.actions()
    wrong = [t for t, action in enumerate(actions) if not is_one_of(action, choices[t])]
    findings["actions"].compared += episode.steps - 1
    if not wrong:
        findings.compare("actions", recording.where, True, True)
        return
    findings.compare(
        "actions",
        f"{recording.where}, {len(wrong)} of {episode.steps} steps, first {wrong[0]}",
        f"action {shown(actions[wrong[0]])}",
        f"action {' or '.join(shown(one) for one in meant(choices[wrong[0]]))}",
        hint=explained(recording, uniforms),
    )


def held(action: int, dims: tuple[int, ...]) -> Choices:
    """The choices of an action's number, in which the last dimension counts fastest."""
    choices = []
    for n in reversed(dims):
        choices.append(action % n)
        action //= n
    return tuple(reversed(choices))


def is_one_of(action: Choices, answers: list[list[set[int]]]) -> bool:
    """Whether an action is what one of these answers may mean."""
    return any(all(c in own for c, own in zip(action, answer, strict=True)) for answer in answers)


def meant(answers: list[list[set[int]]]) -> list[Choices]:
    """All actions that these answers may mean."""
    return sorted({action for answer in answers for action in itertools.product(*answer)})


def shown(action: Choices) -> str:
    return str(action[0]) if len(action) == 1 else str(action)


def answered(recording: Recording, step: int) -> list[int]:
    """The frames to one of which the step's action was the answer: its own, unless actions are delayed.

    A delayed action acts a time after its frame that the episode tells. Which period that falls into shifts by one
    with the robot's clock, and by one more where the action before it acts first. With latencies of several
    lengths the actions before it may hold it up for longer, until the longest latency is over.
    """
    config, loop_ns = recording.config, int(recording.episode.camera_to_action_ns[step])
    if config.pacing == "lockstep":
        return [step]
    if loop_ns == 0:  # none came in time
        return []
    shortest_ms, longest_ms = config.task_spec.disturbances.get("latency", (0.0, 0.0))
    delay_ms, period_ms = (
        config.action_delay_ms + longest_ms,
        1e3 * config.task_spec.control_period_s,
    )
    if delay_ms == 0:
        return [step]
    periods = int(loop_ns / 1e6 / period_ms)
    latest = periods + 1
    if shortest_ms != longest_ms:
        latest = max(latest, 1 + ceil(delay_ms / period_ms))
    return [step - later for later in range(periods, latest + 1) if later <= step]


def explained(recording: Recording, uniforms: list[list[float]]) -> str:
    """What other way of acting gives all of an episode's actions, if one of the likely ones does."""
    beta = inverse_temperature(recording.config, recording.iteration)
    scale, share = recording.policy.scale, epsilon_of_each(recording)
    outputs = recording.episode.outputs.astype(np.float64)
    ways: dict[str, Act] = {
        "a softmax policy": lambda o, u: softmax_choice(o * scale, beta, u),
        "an epsilon-greedy policy": lambda o, u: greedy_choice(o, share, u),
        "the best action always": lambda o, u: greedy_choice(o, 0.0, u),
        "a softmax policy at the run's first beta": lambda o, u: softmax_choice(
            o * scale, recording.config.beta, u
        ),
        "a softmax policy at beta = 1": lambda o, u: softmax_choice(o * scale, 1.0, u),
        "a softmax policy without lambda": lambda o, u: softmax_choice(o, beta, u),
    }
    orders = {
        "": uniforms,
        " with one random number for all steps": [uniforms[0]] * len(uniforms),
    }
    actions = recording.actions()
    for way, act in ways.items():
        for order, numbers in orders.items():
            answers = (
                [act(own, u) for own, u in zip(parts(o, recording.dims), us, strict=True)]
                for o, us in zip(outputs, numbers, strict=True)
            )
            if all(is_one_of(a, [one]) for a, one in zip(actions, answers, strict=True)):
                return f"it is {way}{order}"
    return ""
