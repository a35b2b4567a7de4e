"""Runs of many seeds in one process: ended anywhere, they go on to the same bits."""

import json
from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import Any

import pytest

from bench import seeds
from bench.interrupted import State
from bpn_learner.networks import PNetwork
from bpn_learner.transitions import EpisodeData
from bpn_shared.spec.config import RunConfig

CONFIG = RunConfig.for_task(
    "reaching", iterations=4, episodes=2, steps=5, epochs=2, hidden_units=12, replay_iterations=2,
    reward_scale=0, n_step=2,
)  # fmt: skip
Policies = Iterator[tuple[dict[str, Any], PNetwork, list[EpisodeData]]]


def told(policies: Policies) -> list[dict[str, Any]]:
    return [{k: v for k, v in record.items() if k != "cpu_s"} for record, *_ in policies]


@pytest.fixture(scope="module")
def whole() -> list[dict[str, Any]]:
    return told(seeds.policies(CONFIG))


@pytest.mark.parametrize("ended_after", [1, 2, 3])
def test_a_run_that_was_ended_goes_on_to_the_same_bits(
    whole: list[dict[str, Any]], ended_after: int, tmp_path: Path
) -> None:
    state = State(tmp_path / "state")
    first = told(islice(seeds.policies(CONFIG, state=state), ended_after))
    # the iteration that was told last may not have been kept: it is made again
    rest = told(seeds.policies(CONFIG, state=state))
    assert first == whole[:ended_after]
    assert rest == whole[ended_after - 1 :]
    assert len(list((tmp_path / "state").glob("*.npz"))) <= CONFIG.replay_iterations + 1


def test_a_files_lines_are_told_once_each(tmp_path: Path) -> None:
    arguments = [
        "reaching", "--out", str(tmp_path), "--trials", "0", "--name", "small", "--set", "iterations=3",
        "episodes=2", "steps=5", "epochs=2", "hidden_units=12",
    ]  # fmt: skip
    part = tmp_path / "reaching-small-s0.part"
    part.write_text(
        '{"iteration": 0, "return": 7}\n{"iteration": 1, "retu'
    )  # of a run without a state
    seeds.main(arguments)
    lines = (tmp_path / "reaching-small-s0.jsonl").read_text().splitlines()
    assert [json.loads(line)["iteration"] for line in lines] == [0, 1, 2]
    assert json.loads(lines[0])["return"] < 0
    assert {path.name for path in tmp_path.iterdir()} == {"reaching-small-s0.jsonl"}
