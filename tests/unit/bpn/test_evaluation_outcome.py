"""What trials come to, and the film of them."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import imageio.v3 as imageio
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from paper import TASKS

from bpn.evaluation import video
from bpn.evaluation.outcome import Outcome, distinct_trials, outcome, summarize
from bpn.evaluation.shown import shown
from bpn_shared.messages.episode import Episode, EpisodeMeta
from bpn_shared.runs.success import share, success_of
from bpn_shared.spec.config import RunConfig

TRACKING = RunConfig.for_task("tracking")
GYM = RunConfig.for_task("gym:MountainCar-v0", actions=3)


def disc_at(x_px: float) -> np.ndarray:
    """A frame of tracking with the target on its middle row."""
    rows, columns = np.mgrid[:84, :84]
    inside = (columns - x_px) ** 2 + (rows - 41.5) ** 2 <= 12.0**2
    return np.where(inside, np.array([255, 160, 0], np.uint8)[:, None, None], 0).astype(np.uint8)


def episode(
    places_px: list[float], *, terminated: bool, actions: list[int] | None = None
) -> Episode:
    steps = len(places_px) - 1
    meta = EpisodeMeta(
        iteration=0, episode=0, seed=0, slot=0, worker="edge", weights_attempt=1, weights_version=0,
        terminated=terminated, deadline_misses=1, duration_ns=0,
    )  # fmt: skip
    return Episode(
        meta=meta,
        frames=np.stack([disc_at(x_px) for x_px in places_px]),
        actions=np.array(actions or [3] * steps, np.uint8),
        outputs=np.tile(np.arange(7, dtype=np.int32), (steps, 1)),
        rewards=np.full(steps, np.nan),
        inference_ns=np.ones(steps, np.uint32),
        camera_to_action_ns=np.ones(steps, np.uint32),
    )


def test_return_and_success_come_from_what_was_seen() -> None:
    kept = outcome(TRACKING, episode([41.5, 51.5, 31.5], terminated=False))
    assert kept == Outcome(
        total=pytest.approx(-20.0, abs=0.2),
        steps=2,
        terminated=False,
        success=True,
        deadline_misses=1,
    )
    assert not outcome(TRACKING, episode([41.5, 51.5], terminated=True)).success


def test_the_summary_is_in_the_units_of_table_two() -> None:
    outcomes = [Outcome(-800.0, 40, False, True, 0), Outcome(-100.0, 10, True, False, 2)]
    summary = summarize(TRACKING, outcomes)
    assert summary["return_px"] == {"mean": -450.0, "std": 494.975}
    assert summary["px_per_step"] == {"mean": -15.0, "std": 7.071}
    assert summary["tracking_time"] == {"steps": 25.0, "seconds": 3.625, "percent": 62.5}
    assert (summary["success_share"], summary["terminated"]) == (0.5, 1)
    assert summary["deadline_misses"] == 2
    assert (summary["lengths"], summary["successes"]) == ([40, 10], [True, False])
    assert summarize(TRACKING, outcomes[:1])["return_px"] == {"mean": -800.0, "std": None}
    with pytest.raises(ValueError, match="nothing was played"):
        summarize(TRACKING, [])


@pytest.mark.parametrize("terminated", [False, True])
@pytest.mark.parametrize("told", [None, False, True])
def test_success_of_a_gym_task_is_what_the_environment_says(
    told: bool | None, terminated: bool
) -> None:
    played = episode([1.0, 2.0], terminated=terminated)
    meta = played.meta.model_copy(update={"success": told})
    seen = outcome(GYM, replace(played, meta=meta, rewards=np.array([-1.0])))
    assert (seen.success, seen.terminated) == (told, terminated)
    summary = summarize(GYM, [seen, seen])
    assert summary["success_share"] == (None if told is None else float(told))
    assert json.loads(json.dumps(summary))["successes"] == [told, told]


@given(st.lists(st.sampled_from([None, False, True])))
def test_a_share_counts_only_where_success_is_defined(successes: list[bool | None]) -> None:
    defined = [one for one in successes if one is not None]
    assert share(successes) == (float(np.mean(defined)) if defined else None)


def test_reaching_succeeds_where_the_hand_ends_on_the_target() -> None:
    meta = episode([1.0, 2.0], terminated=False).meta
    for distance_px, success in ((5.0, True), (5.01, False)):
        assert success_of(TASKS["reaching"], meta, np.array([-90.0, -distance_px])) is success


def test_a_film_shows_every_frame_enlarged_and_the_applied_action_beside_it() -> None:
    shown = episode([20.0, 41.5, 60.0], terminated=False, actions=[6, 0])
    pictures = list(video.pictures_of(shown, TASKS["tracking"]))
    assert len(pictures) == 3
    for picture, frame in zip(pictures, shown.frames, strict=True):
        height, width, _ = picture.shape
        assert (height % 2, width % 2) == (0, 0)  # or no player shows the film
        np.testing.assert_array_equal(picture[: 84 * 4 : 4, : 84 * 4 : 4], frame.transpose(1, 2, 0))
    assert pictures[0].shape == (336, 336 + 128, 3)
    assert next(video.pictures_of(shown, TASKS["tracking"], bars=False)).shape == (336, 336, 3)
    lengths = [_bar_lengths(picture[:, 336:]) for picture in pictures[:2]]
    assert lengths[0] == lengths[1] == sorted(lengths[0])  # outputs are 0, 1, ... 6
    chosen = [
        np.argwhere((p[:, 336:] == video._CHOSEN).all(axis=2))[:, 0].mean() for p in pictures[:2]
    ]
    assert chosen[0] > chosen[1]  # action 6 is the lowest bar, action 0 the uppermost


def _bar_lengths(panel: np.ndarray) -> list[int]:
    lit = (panel != np.array(video._BACKGROUND)).any(axis=2).sum(axis=1)
    starts = np.flatnonzero((lit > 0) & (np.roll(lit, 1) == 0))
    return [int(lit[start]) for start in starts]


@pytest.mark.parametrize("name", ["film.mp4", "film.gif"])
def test_a_written_film_has_all_frames_of_all_trials(name: str, tmp_path: Path) -> None:
    trials = [episode([20.0, 41.5, 60.0], terminated=False)] * 2
    video.write(tmp_path / name, trials, TASKS["tracking"])
    read = imageio.imread(tmp_path / name)
    assert read.shape[1:] == (336, 464, 3)
    # a gif merges equal neighbours, of which there are none here
    assert len(read) == 6
    middle = read[1][4 * 41, 4 * 41].astype(int)
    assert np.abs(middle - [255, 160, 0]).max() < 30  # compressed


def result_of(config: RunConfig, episodes: list[Episode], policy: str = "greedy") -> dict[str, Any]:
    outcomes = [outcome(config, one) for one in episodes]
    facts = {"weights_version": 1, "run_id": "r", "policy": policy, "pacing": config.pacing}
    return facts | summarize(config, outcomes, distinct=distinct_trials(episodes))


def test_the_same_trial_played_again_says_nothing_of_a_spread() -> None:
    one, other = (episode([41.5, x_px, 31.5], terminated=False) for x_px in (51.5, 50.5))
    alike, differing = (result_of(TRACKING, episodes) for episodes in ([one] * 5, [one, other]))
    assert (alike["trials"], alike["distinct_trials"]) == (5, 1)
    assert alike["return_px"]["std"] is alike["length"]["std"] is None
    lines = shown(alike, TRACKING)
    assert any(line.startswith("1 start: all trials are the same one") for line in lines)
    assert "± - px" in lines[1]
    assert differing["distinct_trials"] == 2
    assert differing["return_px"]["std"] > 0
    assert not any("1 start" in line for line in shown(differing, TRACKING))


@pytest.mark.parametrize("algorithm", ["bpn", "cvi", "dpp", "bqn", "dqn"])
def test_softmax_play_of_who_trains_otherwise_says_so(algorithm: str) -> None:
    config = RunConfig.for_task("tracking", algorithm=algorithm)
    result = result_of(config, [episode([41.5, 51.5], terminated=False)], policy="softmax")
    said = any(f"softmax is not how {algorithm} trains" in one for one in shown(result, config))
    assert said == (config.policy != "softmax") == (algorithm in ("bqn", "dqn"))
