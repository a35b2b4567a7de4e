"""TensorBoard's own reader says what the event files hold."""

import json
from pathlib import Path

import pytest
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from bpn_learner.events import EventWriter
from bpn_shared.spec.config import RunConfig

CONFIG = RunConfig.for_task("reaching", seed=4)


def record(iteration: int, value: float) -> dict[str, object]:
    return {
        "iteration": iteration,
        "time_unix_s": 1.7e9 + iteration,
        "return_px": value,
        "failures": 2,
        "returns_px": [1.0, 2.0],
        "weights_sha256": "00",
    }


def read(folder: Path) -> EventAccumulator:
    return EventAccumulator(str(folder)).Reload()


def test_every_number_is_there_under_its_name(tmp_path: Path) -> None:
    events = EventWriter(tmp_path, CONFIG, 0)
    for iteration in range(3):
        events.write(record(iteration, -100.0 * iteration))
    found = read(tmp_path)  # flushed, though not closed
    points = found.Scalars("return_px")
    assert [(p.step, p.value) for p in points] == [(0, 0.0), (1, -100.0), (2, -200.0)]
    assert points[2].wall_time == 1.7e9 + 2
    assert {"failures", "return_px", "iteration", "time_unix_s"} == set(found.Tags()["scalars"])
    (text,) = found.Tensors("config/text_summary")
    shown = text.tensor_proto.string_val[0].decode().removeprefix("```json").removesuffix("```")
    assert json.loads(shown) == CONFIG.model_dump()
    events.close()


def test_a_resumed_run_replaces_what_it_repeats(tmp_path: Path) -> None:
    first = EventWriter(tmp_path, CONFIG, 0)
    for iteration in range(3):
        first.write(record(iteration, 1.0))
    first.close()
    second = EventWriter(tmp_path, CONFIG, 2)  # the checkpoint was one iteration behind
    for iteration in (2, 3):
        second.write(record(iteration, 5.0))
    second.close()
    points = read(tmp_path).Scalars("return_px")
    assert [(p.step, p.value) for p in points] == [(0, 1.0), (1, 1.0), (2, 5.0), (3, 5.0)]


def test_a_run_that_was_removed_stays_removed(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        EventWriter(tmp_path / "removed" / "tensorboard", CONFIG, 0)
    assert not list(tmp_path.iterdir())
