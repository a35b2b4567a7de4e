"""TensorBoard's own reader says what the event files hold."""

import json
from pathlib import Path

import pytest
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from bpn_learner.callbacks import RunEnd, UpdateEnd
from bpn_learner.callbacks.tensorboard import TensorBoard
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


class Run:
    """What it needs to know of a run."""

    config, records = CONFIG, ()

    def __init__(self, folder: Path, first: int) -> None:
        self.folder, self.first = folder, first


def written(folder: Path, first: int, last: int, value: float, *, ended: bool = True) -> None:
    """What one attempt writes."""
    callback = TensorBoard(Run(folder, first))  # type: ignore[arg-type]
    for iteration in range(first, last):
        callback.on_update_end(UpdateEnd(iteration, record(iteration, value), None))  # type: ignore[arg-type]
    if ended:
        callback.on_run_end(RunEnd(finished=True, reason=""))


def read(folder: Path) -> EventAccumulator:
    return EventAccumulator(str(folder / "tensorboard")).Reload()


def test_every_number_is_there_under_its_name(tmp_path: Path) -> None:
    written(tmp_path, 0, 3, -100.0, ended=False)
    found = read(tmp_path)  # flushed, though not closed
    points = found.Scalars("return_px")
    assert [(p.step, p.value) for p in points] == [(0, -100.0), (1, -100.0), (2, -100.0)]
    assert points[2].wall_time == 1.7e9 + 2
    assert {"failures", "return_px", "iteration", "time_unix_s"} == set(found.Tags()["scalars"])
    (text,) = found.Tensors("config/text_summary")
    shown = text.tensor_proto.string_val[0].decode().removeprefix("```json").removesuffix("```")
    assert json.loads(shown) == CONFIG.model_dump(mode="json")


def test_a_resumed_run_replaces_what_it_repeats(tmp_path: Path) -> None:
    written(tmp_path, 0, 3, 1.0)
    written(tmp_path, 2, 4, 5.0)  # the checkpoint was one iteration behind
    points = read(tmp_path).Scalars("return_px")
    assert [(p.step, p.value) for p in points] == [(0, 1.0), (1, 1.0), (2, 5.0), (3, 5.0)]


def test_a_run_that_was_removed_stays_removed(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        written(tmp_path / "removed", 0, 1, 1.0)
    assert not list(tmp_path.iterdir())
