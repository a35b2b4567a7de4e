"""Stored episodes: what the robot saw and did, step by step."""

import re
from typing import Annotated

from fastapi import APIRouter, Query, Response
from pydantic import BaseModel, Field

from bpn_dashboard.api.context import Context, Parts, Viewer
from bpn_dashboard.api.problems import ApiError, responses
from bpn_dashboard.api.records import number_at, record_of
from bpn_shared.bnn.envelope import BlobError
from bpn_shared.bnn.weights import decode_weights
from bpn_shared.messages.base import MessageError
from bpn_shared.messages.episode import Episode, decode_meta
from bpn_shared.runs.folder import RunFolder
from bpn_shared.spec.config import RunConfig
from bpn_shared.spec.joint_actions import joined

router = APIRouter(tags=["episodes"])

_NAME = re.compile(r"([0-9]{6,10})-[0-9]{5,10}\.bpne")
_COUNT = Field(ge=0, lt=2**32)


class EpisodeQuery(BaseModel):
    """Which iteration's; without one, the newest that has episodes."""

    model_config = {"extra": "forbid"}

    iteration: Annotated[int | None, _COUNT] = None


NUMBERS = "of several dimensions the last one's choice counts fastest"
SIDE_BY_SIDE = "of several dimensions for each choice, the dimensions' side by side"


class EpisodeItem(BaseModel):
    """An episode that is on disk."""

    iteration: int
    episode: int
    steps: int
    episode_return: Annotated[
        float | None, Field(description="sum of rewards; null until the iteration is learned")
    ]
    weights_version: int
    slot: int
    worker: str


class EpisodeList(BaseModel):
    """The episodes of one iteration in order, and which iterations have any."""

    iteration: int | None
    first_iteration: int | None
    last_iteration: int | None
    items: list[EpisodeItem]


class EpisodeSteps(BaseModel):
    """An episode without its pixels; lists have one entry for each of the T steps."""

    steps: int
    actions: Annotated[list[int], Field(description="numbers of the actions; " + NUMBERS)]
    action_names: Annotated[
        list[str], Field(description="of all actions, by number; " + SIDE_BY_SIDE)
    ]
    action_dims: Annotated[list[int], Field(description="choices of each dimension of an action")]
    outputs: Annotated[
        list[list[float]], Field(description="the network's o for each action; " + SIDE_BY_SIDE)
    ]
    preferences: Annotated[list[list[float]], Field(description="P = lambda * o")]
    rewards: Annotated[list[float] | None, Field(description="null until it is learned from")]
    weights_version: int
    scale: Annotated[float, Field(description="lambda of these weights")]
    camera_to_action_us: Annotated[
        list[float | None], Field(description="null where no action came in time")
    ]
    inference_us: list[float]


@router.get("/runs/{run_id}/episodes", operation_id="listEpisodes", responses=responses(404, 422))
def list_episodes(
    _who: Viewer, parts: Parts, run_id: str, query: Annotated[EpisodeQuery, Query()]
) -> EpisodeList:
    """The stored episodes of an iteration."""
    folder = _folder(parts, run_id)
    found = [match for name in folder.file_names("episodes") if (match := _NAME.fullmatch(name))]
    iterations = [int(match[1]) for match in found]
    first, last = (min(iterations), max(iterations)) if iterations else (None, None)
    iteration = last if query.iteration is None else query.iteration
    if iteration is None:
        return EpisodeList(iteration=None, first_iteration=None, last_iteration=None, items=[])
    record = record_of(folder, "metrics.jsonl", iteration)
    returns = (
        "returns_px" if record and "returns_px" in record else "returns"
    )  # px, or the robot's unit
    items = []
    for match in found:
        if int(match[1]) != iteration:
            continue
        try:
            meta, steps = decode_meta(folder.read_file(f"episodes/{match[0]}"))
        except (MessageError, OSError):  # damaged, or set aside just now
            continue
        items.append(
            EpisodeItem(
                iteration=meta.iteration,
                episode=meta.episode,
                steps=steps,
                episode_return=number_at(record, returns, meta.episode),
                weights_version=meta.weights_version,
                slot=meta.slot,
                worker=meta.worker,
            )
        )
    return EpisodeList(iteration=iteration, first_iteration=first, last_iteration=last, items=items)


@router.get(
    "/runs/{run_id}/episodes/{iteration}/{episode}",
    operation_id="getEpisode",
    responses=responses(404, 422),
)
def get_episode(
    _who: Viewer,
    parts: Parts,
    run_id: str,
    iteration: Annotated[int, _COUNT],
    episode: Annotated[int, _COUNT],
) -> EpisodeSteps:
    """What an episode's robot did, and what the policy thought of it."""
    folder = _folder(parts, run_id)
    config = folder.config()
    task, stored = config.task_spec, _episode(folder, config, iteration, episode)
    scale = _scale(folder, stored.meta.weights_version)
    waited_us = stored.camera_to_action_ns / 1e3
    return EpisodeSteps(
        steps=stored.steps,
        actions=[
            joined(choices, task.dims)
            for choices in stored.actions.reshape(stored.steps, -1).tolist()
        ],
        action_names=list(task.action_names),
        action_dims=list(task.dims),
        outputs=stored.outputs.tolist(),
        preferences=(stored.outputs * scale).tolist(),
        rewards=_rewards(folder, iteration, episode, stored.steps),
        weights_version=stored.meta.weights_version,
        scale=scale,
        camera_to_action_us=[value or None for value in waited_us.tolist()],
        inference_us=(stored.inference_ns / 1e3).tolist(),
    )


@router.get(
    "/runs/{run_id}/episodes/{iteration}/{episode}/frames",
    operation_id="getEpisodeFrames",
    response_class=Response,
    responses=responses(404, 422)
    | {
        200: {
            "content": {"application/octet-stream": {"schema": {"format": "binary"}}},
            "headers": {
                "X-Frames-Shape": {
                    "schema": {"type": "string"},
                    "description": "T+1,channels,height,width",
                }
            },
        }
    },
)
def get_episode_frames(
    _who: Viewer,
    parts: Parts,
    run_id: str,
    iteration: Annotated[int, _COUNT],
    episode: Annotated[int, _COUNT],
) -> Response:
    """An episode's frames: uint8, one after the other, each [channels, height, width]."""
    folder = _folder(parts, run_id)
    frames = _episode(folder, folder.config(), iteration, episode).frames
    return Response(
        frames.tobytes(),
        media_type="application/octet-stream",
        headers={"X-Frames-Shape": ",".join(map(str, frames.shape))},
    )


def _folder(parts: Context, run_id: str) -> RunFolder:
    parts.runs.get(run_id)
    return parts.runs.folder(run_id)


def _episode(folder: RunFolder, config: RunConfig, iteration: int, episode: int) -> Episode:
    path = folder.episode_path(iteration, episode)
    try:
        data = folder.read_file(str(path.relative_to(folder.path)))
        return Episode.decode(data, config.task_spec)
    except FileNotFoundError:
        raise ApiError(404, "unknown-episode", "the run has no such episode on disk") from None
    except OSError as error:
        raise ApiError(422, "damaged-episode", "the stored episode cannot be read") from error
    except MessageError as error:
        raise ApiError(422, "damaged-episode", f"the stored episode is damaged: {error}") from error


def _scale(folder: RunFolder, version: int) -> float:
    path = folder.weights_path(version)
    try:
        return float(decode_weights(folder.read_file(str(path.relative_to(folder.path)))).scale)
    except (OSError, BlobError) as error:
        raise ApiError(422, "damaged-weights", "the episode's weights cannot be read") from error


def _rewards(folder: RunFolder, iteration: int, episode: int, steps: int) -> list[float] | None:
    record = record_of(folder, "rewards.jsonl", iteration)
    rewards = [number_at(record, "rewards_px", episode, step) for step in range(steps)]
    found = [reward for reward in rewards if reward is not None]
    return found if len(found) == steps else None
