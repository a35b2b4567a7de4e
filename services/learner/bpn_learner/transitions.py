"""D as tensors: every frame once, observations gathered from frame indices."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from typing import Self

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from bpn_shared.spec.config import RunConfig
from bpn_shared.spec.observation import changes, frame_indices


@dataclass(frozen=True, eq=False)
class EpisodeData:
    """One episode as the learner uses it.

    Attributes:
        frames: uint8[T+1, c, rows, columns].
        actions: integers [T]; of several dimensions [T, D], the choice in each.
        rewards: float[T], unscaled.
        terminated: the task ended the episode, good or bad, not a time limit.
    """

    frames: npt.NDArray[np.uint8]
    actions: npt.NDArray[np.integer]
    rewards: npt.NDArray[np.floating]
    terminated: bool


@dataclass(frozen=True, eq=False)
class Transitions:
    """The transitions (s, a, r, s') of D, in the order in which `policy_update` shuffles them.

    Attributes:
        frames: uint8[m, c, rows, columns].
        observations: int64[n, frames_stacked], the frames of s, oldest first.
        next_observations: int64[n, frames_stacked], the frames of s'.
        actions: int64[n], or int64[n, D].
        rewards: float32[n], scaled.
        done: bool[n], s' is a failure; a time limit is not.
        steps_left: int64[n], of the episode from s on, whose transitions are one behind the other.

    Raises:
        ValueError: the lengths differ.
    """

    frames: Tensor
    observations: Tensor
    next_observations: Tensor
    actions: Tensor
    rewards: Tensor
    done: Tensor
    steps_left: Tensor

    def __post_init__(self) -> None:
        lengths = {
            name: len(getattr(self, name))
            for name in (
                "observations",
                "next_observations",
                "actions",
                "rewards",
                "done",
                "steps_left",
            )
        }
        if len(set(lengths.values())) > 1:
            raise ValueError(f"transitions have different lengths: {lengths}")

    def __len__(self) -> int:
        return len(self.actions)

    @classmethod
    def from_episodes(
        cls,
        episodes: Sequence[EpisodeData],
        *,
        frames_stacked: int,
        difference: bool = False,
        reward_scale: float = 1.0,
    ) -> Self:
        """D from episodes of at least 1 step, in their order.

        Args:
            difference: whether what changed since the earlier frames of an observation takes their place
                (`bpn_shared.spec.observation`); it is then among D's frames, behind those of its episode.
            reward_scale: factor on rewards.

        Raises:
            ValueError: there is no episode, or one's frames are not one more than its actions.
        """
        if not episodes:
            raise ValueError("D needs at least 1 episode, got 0")
        stacks: list[npt.NDArray[np.int64]] = []
        pictures: list[npt.NDArray[np.uint8]] = []
        first = 0
        for episode in episodes:
            frames = len(episode.frames)
            if not len(episode.actions) == len(episode.rewards) == frames - 1 >= 1:
                raise ValueError(
                    f"an episode of {len(episode.actions)} actions and {len(episode.rewards)} rewards "
                    f"has {frames} frames, each action needs one reward, and one frame after the first"
                )
            indices = np.array(
                [frame_indices(step, frames_stacked) for step in range(frames)], np.int64
            )
            pictures.append(episode.frames)
            if difference:
                for place in range(frames_stacked - 1):
                    pictures.append(changes(episode.frames[indices[:, place]], episode.frames))
                    indices[:, place] = (place + 1) * frames + np.arange(frames)
            stacks.append(first + indices)
            first += frames * (frames_stacked if difference else 1)
        steps_left = [np.arange(len(e.actions), 0, -1) for e in episodes]
        done = [np.arange(1, len(e.frames)) == len(e.actions) * e.terminated for e in episodes]
        return cls(
            frames=torch.from_numpy(np.concatenate(pictures)),
            observations=torch.from_numpy(np.concatenate([s[:-1] for s in stacks])),
            next_observations=torch.from_numpy(np.concatenate([s[1:] for s in stacks])),
            actions=torch.from_numpy(
                np.concatenate([e.actions for e in episodes]).astype(np.int64)
            ),
            rewards=torch.from_numpy(
                (reward_scale * np.concatenate([e.rewards for e in episodes])).astype(np.float32)
            ),
            done=torch.from_numpy(np.concatenate(done)),
            steps_left=torch.from_numpy(np.concatenate(steps_left)),
        )

    def to(self, device: torch.device) -> Self:
        """The same transitions on a device."""
        tensors = {f.name: getattr(self, f.name).to(device) for f in fields(self)}
        return type(self)(**tensors)

    def gather(self, stacks: Tensor) -> Tensor:
        """Observations of frame indices, see `gather_observations`."""
        return gather_observations(self.frames, stacks)

    def parts(self, stacks: Tensor, size: int) -> Iterator[Tensor]:
        """The same, `size` at once: all together may take many times the memory of the frames."""
        return (self.gather(part) for part in torch.split(stacks, size))


def data_of(
    config: RunConfig, episodes: Sequence[EpisodeData], reward_scale: float = 1.0
) -> Transitions:
    """Episodes as a run's observations are made of them."""
    return Transitions.from_episodes(
        episodes,
        frames_stacked=config.task_spec.frames_stacked,
        difference=config.difference,
        reward_scale=reward_scale,
    )


def gather_observations(frames: Tensor, stacks: Tensor) -> Tensor:
    """Observations of frame indices int64[n, frames_stacked] into uint8[m, c, rows, columns].

    Returns:
        uint8[n, C, rows, columns], channels-last in memory; C = frames_stacked * c.
    """
    observations = frames[stacks].flatten(1, 2)
    return observations.contiguous(memory_format=torch.channels_last)
