"""Training with callbacks: what they do, and that nothing of theirs reaches what is learned."""

import contextlib
import importlib
import logging
import shutil
import sys
import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any
from uuid import UUID

import pytest
import torch
from installed import install
from played import CONFIG, episode

from bpn_learner.callbacks.calling import MAX_ADDED
from bpn_learner.evaluations import STREAM, Evaluations
from bpn_learner.factory import initial_policy
from bpn_learner.ledger import EpisodeLedger
from bpn_learner.training import Training
from bpn_learner.trials import EVALUATION
from bpn_shared.counters import Counters
from bpn_shared.messages.control import Assignment, Fault, NextEpisode
from bpn_shared.plugins import PluginError
from bpn_shared.runs.folder import RunFolder
from bpn_shared.spec.config import ConfigError, RunConfig
from bpn_shared.spec.seeds import episode_seed
from bpn_shared.spec.stopping import StopRule
from bpn_shared.waiting import WaitStatus

OWN = Path(__file__).parents[2] / "support" / "odd_callbacks.py"
_OWN_NAMES = ("Seen", "Bad", "Odd", "Talkative", "Endless", "Late", "Meddler", "unmade")


@pytest.fixture
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """An installed package with callbacks."""
    site = tmp_path / "site"
    site.mkdir()
    shutil.copy(OWN, site / "own_callbacks.py")
    points = {name: f"own_callbacks:{name}" for name in _OWN_NAMES}
    install(site, "own-callbacks", {"bpn.callbacks": points})
    monkeypatch.syspath_prepend(site)
    monkeypatch.delitem(sys.modules, "own_callbacks", raising=False)
    return importlib.import_module("own_callbacks")


class Loop:
    """One attempt at a run, with an edge that plays whatever it is told."""

    def __init__(self, folder: RunFolder, *, faulty: bool = False) -> None:
        self.folder, self.faulty = folder, faulty
        self.trials: list[Assignment] = []
        self.counters = Counters()
        self.training: Training | None = None

    def run(self) -> bool:
        with self.folder.owned("learner-1") as owner:
            owner.begin_attempt()
            config, waiting = self.folder.config(), WaitStatus()
            self.ledger = EpisodeLedger(config, owner, {"edge-0"}, waiting, self.counters)
            self.evaluations = Evaluations(config, {"edge-0"}, waiting, prove=owner.prove)
            self.training = Training(
                config, owner, self.ledger, publish=lambda _: None, report=lambda *_: None,
                rendezvous=None, waiting=waiting, stop=threading.Event(),
                evaluations=self.evaluations, counters=self.counters,
            )  # fmt: skip
            with self._edge():
                return self.training.run()

    @contextlib.contextmanager
    def _edge(self) -> Iterator[None]:
        stop = threading.Event()
        thread = threading.Thread(target=self._play, args=(stop,))
        thread.start()
        try:
            yield
        finally:
            stop.set()
            thread.join(10)

    def _play(self, stop: threading.Event) -> None:
        asked = NextEpisode(slot=0, worker="edge-0")
        while not stop.is_set():
            told = self.evaluations.next(asked) or self.ledger.next(asked)
            if told.status != "play":
                stop.wait(0.001)
                continue
            is_trial = told.iteration >= EVALUATION
            if is_trial:
                self.trials.append(told)
            if is_trial and self.faulty:
                fault = Fault(iteration=told.iteration, episode=0, worker="edge-0", reason="dark")
                assert self.evaluations.fault(fault)
                continue
            made = episode(
                0 if is_trial else told.iteration, told.episode, seed=told.seed,
                weights_attempt=told.weights_attempt, weights_version=told.weights_version,
            )  # fmt: skip
            meta = made.meta.model_copy(update={"iteration": told.iteration})
            data = replace(made, meta=meta).encode()
            _ = self.evaluations.receive(data) or self.ledger.receive(data)


def loop(runs_dir: Path, **changes: Any) -> Loop:
    config = RunConfig.model_validate(CONFIG.model_dump() | changes)
    return Loop(RunFolder.create(runs_dir, UUID(int=1), config))


def shas(folder: RunFolder) -> list[object]:
    return [record["weights_sha256"] for record in folder.metrics()]


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    """The run without callbacks."""
    one = loop(tmp_path_factory.mktemp("plain"))
    assert one.run()
    return one.folder


EVALUATED = {"evaluate_every": 3, "evaluate_episodes": 2}


def test_hooks_are_called_in_order_and_what_is_learned_stays_the_same(
    tmp_path: Path, own: Any, plain: RunFolder
) -> None:
    one = loop(tmp_path / "runs", callbacks="Seen", **EVALUATED)
    assert one.run()
    assert own.Seen.calls == [
        ("collection", 0, 4, {2}), ("update", 0, False, 1),
        ("collection", 1, 4, {2}), ("update", 1, False, 2),
        ("collection", 2, 4, {2}), ("evaluation", 2, 2, 3), ("update", 2, True, 3),
        ("collection", 3, 4, {2}), ("evaluation", 3, 2, 4), ("update", 3, True, 4),
        ("run", True, ""),
    ]  # fmt: skip
    assert shas(one.folder) == shas(plain)
    assert [record["twice"] for record in one.folder.metrics()] == [0, 2, 4, 6]
    assert one.counters.snapshot().get("callbacks_failed", 0) == 0
    timed = {"time_unix_s", "update_s", "collect_s", "iteration_s", "weights_version_lag"}
    added = {"twice", "eval_return", "eval_success", "eval_s"}
    for record, same in zip(one.folder.metrics(), plain.metrics(), strict=True):
        left = {name: value for name, value in record.items() if name not in timed | added}
        assert left == {name: value for name, value in same.items() if name not in timed}


def test_an_evaluation_is_greedy_has_seeds_of_its_own_and_leaves_no_episode(tmp_path: Path) -> None:
    one = loop(tmp_path, **EVALUATED)
    assert one.run()
    assert [(t.policy, t.epsilon) for t in one.trials] == [("epsilon_greedy", 0.0)] * 4
    assert [t.weights_version for t in one.trials] == [3, 3, 4, 4]
    fixed = [episode_seed(CONFIG.seed, STREAM, trial) for trial in range(2)]
    assert [t.seed for t in one.trials] == fixed * 2
    training = {episode_seed(CONFIG.seed, i, e) for i in range(4) for e in range(4)}
    later = {episode_seed(CONFIG.seed, EVALUATION, trial) for trial in range(2)}
    assert not (training | later) & set(fixed)
    assert len(list((one.folder.path / "episodes").iterdir())) == 16
    told = [record.get("eval_return") for record in one.folder.metrics()]
    assert told[:2] == [None, None]
    assert told[2] == told[3]
    assert one.folder.best().version == 3  # of equal ones the first
    assert one.folder.best().value == told[2]


def test_what_raises_is_counted_with_one_line_and_alters_nothing(
    tmp_path: Path, own: Any, plain: RunFolder, caplog: pytest.LogCaptureFixture
) -> None:
    one = loop(tmp_path / "runs", callbacks="Bad,Seen", **EVALUATED)
    with caplog.at_level(logging.WARNING):
        assert one.run()
    assert one.counters.snapshot()["callbacks_failed"] == 4 + 4 + 2 + 1
    (line, *_) = [r.getMessage() for r in caplog.records if "callback" in r.getMessage()]
    assert (
        "callback 'Bad' at the end of the collection, iteration 0: KeyError: 'collection'" in line
    )
    assert "\n" not in line
    assert shas(one.folder) == shas(plain)
    assert [r["return_px"] for r in one.folder.metrics()] == [
        r["return_px"] for r in plain.metrics()
    ]
    assert own.Seen.calls[-1] == ("run", True, "")


def test_torchs_settings_are_the_trainings_whatever_callbacks_do_to_them(
    tmp_path: Path, own: Any, plain: RunFolder
) -> None:
    def settings() -> list[object]:
        return [
            torch.get_num_threads(), torch.get_default_dtype(), torch.is_grad_enabled(),
            torch.are_deterministic_algorithms_enabled(), torch.get_float32_matmul_precision(),
            torch.backends.cudnn.allow_tf32,
            torch.get_rng_state().tolist(),
        ]  # fmt: skip

    assert own
    initial_policy(CONFIG)  # sets those of a learner
    before = settings()
    one = loop(tmp_path / "runs", callbacks="Meddler", **EVALUATED)
    assert one.run()
    assert one.counters.snapshot().get("callbacks_failed", 0) == 0
    assert settings() == before
    assert shas(one.folder) == shas(plain)


def test_what_cannot_be_written_down_is_refused_where_it_is_said(
    tmp_path: Path, own: Any, plain: RunFolder
) -> None:
    one = loop(tmp_path / "runs", callbacks="Odd", iterations=1)
    assert one.run()
    assert len(own.Odd.errors) == 9, own.Odd.errors
    (record,), (same, *_) = one.folder.metrics(), plain.metrics()
    assert record.keys() == same.keys()
    assert record["weights_sha256"] == same["weights_sha256"]


def test_callbacks_add_so_many_metrics_and_no_more(tmp_path: Path, own: Any) -> None:
    assert own
    one = loop(tmp_path / "runs", callbacks="Talkative")
    assert one.run()
    names = {name for record in one.folder.metrics() for name in record if "metric_" in name}
    assert len(names) == MAX_ADDED
    assert one.counters.snapshot()["callbacks_failed"] == 3
    assert "at most 100 metrics" in one.counters.reasons()["callbacks_failed"]


def test_an_evaluation_within_an_evaluation_is_refused(tmp_path: Path, own: Any) -> None:
    assert own
    one = loop(tmp_path / "runs", callbacks="Endless", **EVALUATED)
    assert one.run()
    assert len(one.trials) == 4
    assert "an evaluation is going on" in one.counters.reasons()["callbacks_failed"]


def test_who_stops_a_run_at_its_last_iteration_did_not_end_it_early(
    tmp_path: Path, own: Any
) -> None:
    one = loop(tmp_path / "runs", callbacks="Late,Seen")
    assert one.run()
    assert one.training is not None
    assert one.training.ended_early == ""
    assert own.Seen.calls[-1] == ("run", True, "")


def test_any_number_of_a_record_may_end_a_run(tmp_path: Path) -> None:
    one = loop(tmp_path, **EVALUATED)
    assert one.run()
    record = one.folder.metrics()[-1]
    numbers = {name for name, value in record.items() if isinstance(value, int | float)}
    assert {"eval_return", "eval_s", "loss", "collect_s", "iteration_s"} <= numbers
    for name in numbers:
        StopRule.parse(f"{name} > 1").check("return_px", evaluated=True)


def test_an_evaluation_that_cannot_be_played_ends_no_training(
    tmp_path: Path, plain: RunFolder
) -> None:
    one = loop(tmp_path, **EVALUATED)
    one.faulty = True
    assert one.run()
    assert "trial 0 cannot be played: dark" in one.counters.reasons()["callbacks_failed"]
    assert shas(one.folder) == shas(plain)
    assert "eval_return" not in one.folder.metrics()[-1]
    with pytest.raises(ConfigError, match=r"best.json: No such file.*evaluate_every"):
        one.folder.best()


def test_a_run_ends_early_as_finished_with_the_reason_and_again_when_resumed(
    tmp_path: Path, own: Any, plain: RunFolder
) -> None:
    one = loop(tmp_path / "runs", stop_when="twice >= 2", callbacks="Seen")
    for _ in range(2):
        assert one.run()
        assert one.training is not None
        assert one.training.ended_early == "stopped early after iteration 1: twice = 2 >= 2"
        assert own.Seen.calls[-1] == ("run", True, one.training.ended_early)
    assert shas(one.folder) == shas(plain)[:2]


def test_a_rule_on_a_metric_that_is_not_there_is_said_once(
    tmp_path: Path, own: Any, caplog: pytest.LogCaptureFixture
) -> None:
    assert own  # callbacks may add any metric, so that the configuration is taken
    one = loop(tmp_path, callbacks="Seen", stop_when="retrun_px > -1000")
    assert one.run()
    (line,) = [r.getMessage() for r in caplog.records if "stop_when" in r.getMessage()]
    assert "the metrics have no retrun_px; they have iteration" in line
    assert "return_px" in line


@pytest.mark.parametrize(("name", "what"), [
    ("nowhere", "callback 'nowhere' is not installed here; there are: .*evaluation"),
    ("unmade", "callback 'unmade' .own_callbacks:unmade of own-callbacks 1.0. is broken: .*no"),
])  # fmt: skip
def test_one_that_is_not_there_or_cannot_be_made_is_said_before_anything_is_played(
    tmp_path: Path, own: Any, name: str, what: str
) -> None:
    assert own
    one = loop(tmp_path / "runs", callbacks=name)
    with pytest.raises(PluginError, match=what):
        one.run()
    assert not list((one.folder.path / "episodes").iterdir())


def test_the_note_of_the_best_is_checked(tmp_path: Path) -> None:
    one = loop(tmp_path, **EVALUATED)
    assert one.run()
    path = one.folder.path / "best.json"
    path.write_bytes(path.read_bytes().replace(b'"version": 3', b'"version": 4'))
    with pytest.raises(ConfigError, match=r"best.json is damaged: choose a version by --version"):
        one.folder.best()
