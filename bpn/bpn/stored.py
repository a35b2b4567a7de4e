"""The episodes that a run folder holds."""

import logging
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from bpn_shared.messages.base import MessageError
from bpn_shared.messages.episode import Episode
from bpn_shared.plugins import PluginError
from bpn_shared.runs.folder import RunFolder
from bpn_shared.spec.tasks import TaskSpec

log = logging.getLogger(__name__)


def stored_episodes(folder: RunFolder, *, iteration: int | None = None) -> Iterator[Episode]:
    """The stored episodes in order, as delivered; a damaged one is left out, and told.

    Args:
        iteration: only its episodes.
    """
    task = folder.config().task_spec
    beginning = "" if iteration is None else f"{iteration:06d}-"
    for name in sorted(folder.file_names("episodes", suffix=".bpne")):
        if not name.startswith(beginning):
            continue
        try:
            yield Episode.decode(folder.read_file(f"episodes/{name}"), task)
        except MessageError as error:
            log.warning("%s is damaged and left out: %s", folder.path / "episodes" / name, error)


def with_rewards(episode: Episode, task: TaskSpec, told: dict[int, list[list[float]]]) -> Episode:
    """The episode with the rewards that it was learned from, whoever knew them.

    Args:
        told: of each iteration's episodes to a thousandth, as `RunFolder.rewards` has them: for where the task's
            rewards are not installed.

    Raises:
        PluginError: they are not installed, and nobody told them.
        RewardError: the frames do not show what the reward is computed from.
    """
    from bpn_learner.reward import episode_rewards  # noqa: PLC0415 - it may load OpenCV

    try:
        return replace(episode, rewards=episode_rewards(task, episode))
    except PluginError:
        iteration = told.get(episode.meta.iteration, [])
        if episode.meta.episode >= len(iteration):
            raise
        return replace(episode, rewards=np.array(iteration[episode.meta.episode], np.float64))
