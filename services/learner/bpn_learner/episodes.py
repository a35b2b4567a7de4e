"""What makes an episode data of a run, and the episodes that its folder has already."""

import logging
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bpn_learner.reward import RewardError, Rewards, episode_rewards
from bpn_shared.messages.base import MessageError, OtherVersionError
from bpn_shared.messages.episode import Episode
from bpn_shared.runs.ownership import Ownership
from bpn_shared.spec.config import RunConfig
from bpn_shared.spec.seeds import episode_seed

log = logging.getLogger(__name__)


class DataError(RuntimeError):
    """Data of the run cannot be had as they were; the message says which, why, and what to do."""


class EpisodeError(ValueError):
    """An episode is no data of the run; the message says why."""


@dataclass(frozen=True, eq=False)
class Scored:
    """An episode with its rewards.

    Attributes:
        rewards: finite float64[T], unscaled: in pixels, or the robot's own.
        kept: it was on disk when the collection began.
    """

    episode: Episode
    rewards: Rewards
    kept: bool = False


def score(episode: Episode, config: RunConfig, *, kept: bool = False) -> Scored:
    """The episode with its rewards; the paper's tasks have them from the pixels alone (section VI-A).

    Raises:
        EpisodeError: it is no data of a run with this configuration.
    """
    reason = why_invalid(episode, config)
    if reason is not None:
        raise EpisodeError(reason)
    try:
        rewards = episode_rewards(config.task_spec, episode)
    except RewardError as error:
        raise EpisodeError(str(error)) from error
    odd = np.flatnonzero(~np.isfinite(rewards))
    if len(odd):
        raise EpisodeError(
            f"the reward of step {odd[0]} is {rewards[odd[0]]}, every step needs a finite one"
        )
    return Scored(episode, rewards, kept)


def why_invalid(episode: Episode, config: RunConfig) -> str | None:
    """What keeps an episode from being data of a run with this configuration, if anything does."""
    meta = episode.meta
    if meta.episode >= config.episodes:
        return f"an iteration has episodes 0..{config.episodes - 1}"
    if meta.seed != episode_seed(config.seed, meta.iteration, meta.episode):
        return f"seed {meta.seed} is another run's"
    if meta.weights_version != meta.iteration:
        return f"played with weights version {meta.weights_version}"
    outputs = "int32" if config.algorithm_spec.network == "binary" else "float32"
    if episode.outputs.dtype.name != outputs:
        return f"outputs are {episode.outputs.dtype.name}, {config.algorithm} has {outputs}"
    # an environment that tells rewards may end an episode for reasons of its own
    may_be_short = meta.terminated or config.task_spec.rewards == "robot"
    if episode.steps > config.steps or (episode.steps < config.steps and not may_be_short):
        return f"{episode.steps} steps, an episode of this run has {config.steps}"
    return None


def load_episodes(
    owner: Ownership, config: RunConfig, iteration: int, oldest_attempt: int = 0
) -> dict[int, Scored]:
    """An iteration's stored episodes by e; a file that is no episode of it is set aside.

    Whoever asks has to see to what is missing.

    Args:
        oldest_attempt: whose weights of that version are those of now; of older ones, other weights played.

    Raises:
        DataError: a file cannot be read, or another version wrote it.
        OwnershipLostError: another learner has taken the run over.
    """
    found: dict[int, Scored] = {}
    for index in range(config.episodes):
        path = owner.folder.episode_path(iteration, index)
        try:
            data = owner.folder.read_file(f"episodes/{path.name}")
        except FileNotFoundError:
            continue
        except OSError as error:
            raise DataError(
                f"{path} cannot be read: {error.strerror}; mend or remove it"
            ) from error
        try:
            found[index] = _read(data, config, (iteration, index), oldest_attempt)
        except OtherVersionError as error:
            raise DataError(f"{path}: {error}") from error
        except (MessageError, EpisodeError) as error:
            aside = _set_aside(owner, path)
            log.warning("%s is no data (%s): set aside as %s", path, error, aside.name)
    return found


def _read(data: bytes, config: RunConfig, which: tuple[int, int], oldest_attempt: int) -> Scored:
    episode = Episode.decode(data, config.task_spec)
    meta = episode.meta
    if (meta.iteration, meta.episode) != which:
        raise EpisodeError(f"it is episode ({meta.iteration}, {meta.episode})")
    if meta.weights_attempt < oldest_attempt:
        raise EpisodeError(f"weights of attempt {meta.weights_attempt} played it, which are others")
    return score(episode, config, kept=True)


def _set_aside(owner: Ownership, path: Path) -> Path:
    try:
        return owner.set_aside(path)
    except OSError as error:
        raise DataError(f"{path} is damaged and cannot be renamed: {error.strerror}") from error
