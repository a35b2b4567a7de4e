"""Episodes as a run folder has them, compared with what the robot's side should have done."""

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
"""From outputs and a uniform number to actions."""


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

    def choice(self, step: int, uniform: float) -> set[int]:
        """What the run's policy does on the outputs that the edge recorded."""
        P = self.episode.outputs[step].astype(np.float64) * self.policy.scale
        if self.config.policy == SOFTMAX:
            return softmax_choice(P, inverse_temperature(self.config, self.iteration), uniform)
        return greedy_choice(P, epsilon(self.config, self.iteration), uniform)


def epsilon(config: RunConfig, iteration: int) -> float:
    """Share of random actions: falls on a line over the first half of the run; 0 of a softmax policy."""
    if not config.algorithm_spec.explores:
        return 0.0
    progress = min(1.0, iteration / (config.iterations / 2))
    return config.epsilon_initial + progress * (config.epsilon_final - config.epsilon_initial)


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
    actions = torch.from_numpy(episode.actions.astype(np.int64))
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
    uniforms = draws.step_uniforms(episode.meta.seed, episode.steps)
    answers = [recording.choice(step, number) for step, number in enumerate(uniforms)]
    choices = [
        set().union(*(answers[frame] for frame in frames))
        if frames
        else {config.task_spec.hold_action}
        for frames in (answered(recording, step) for step in range(episode.steps))
    ]
    wrong = [t for t, action in enumerate(episode.actions.tolist()) if action not in choices[t]]
    findings["actions"].compared += episode.steps - 1
    if not wrong:
        findings.compare("actions", recording.where, True, True)
        return
    findings.compare(
        "actions",
        f"{recording.where}, {len(wrong)} of {episode.steps} steps, first {wrong[0]}",
        f"action {episode.actions[wrong[0]]}",
        f"action {' or '.join(map(str, sorted(choices[wrong[0]])))}",
        hint=explained(recording, uniforms),
    )


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


def explained(recording: Recording, uniforms: list[float]) -> str:
    """What other way of acting gives all of an episode's actions, if one of the likely ones does."""
    config, scale = recording.config, recording.policy.scale
    beta = inverse_temperature(config, recording.iteration)
    share = epsilon(config, recording.iteration)
    outputs = recording.episode.outputs.astype(np.float64)
    ways: dict[str, Act] = {
        "a softmax policy": lambda o, u: softmax_choice(o * scale, beta, u),
        "an epsilon-greedy policy": lambda o, u: greedy_choice(o, share, u),
        "the best action always": lambda o, u: greedy_choice(o, 0.0, u),
        "a softmax policy at the run's first beta": lambda o, u: softmax_choice(
            o * scale, config.beta, u
        ),
        "a softmax policy at beta = 1": lambda o, u: softmax_choice(o * scale, 1.0, u),
        "a softmax policy without lambda": lambda o, u: softmax_choice(o, beta, u),
    }
    orders = {
        "": uniforms,
        " with one random number for all steps": [uniforms[0]] * len(uniforms),
    }
    actions = recording.episode.actions.tolist()
    for way, act in ways.items():
        for order, numbers in orders.items():
            pairs = zip(outputs, numbers, actions, strict=True)
            if all(action in act(o, u) for o, u, action in pairs):
                return f"it is {way}{order}"
    return ""
