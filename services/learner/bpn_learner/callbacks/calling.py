"""Calls a run's callbacks, whatever they raise."""

import logging
import re
from collections.abc import Callable, Mapping
from copy import deepcopy
from math import isfinite
from pathlib import Path

from bpn_learner.callbacks.callback import (
    Callback,
    CollectionEnd,
    EvaluationEnd,
    RunEnd,
    TrainingRun,
    UpdateEnd,
)
from bpn_learner.callbacks.settings import settings_kept
from bpn_shared import plugins
from bpn_shared.bnn.weights import Weights
from bpn_shared.counters import Counters
from bpn_shared.errors import one_line
from bpn_shared.runs.ownership import Ownership
from bpn_shared.spec.config import RunConfig

log = logging.getLogger(__name__)

Play = Callable[[int, Weights, int], EvaluationEnd | None]
"""Plays so many greedy episodes of weights, after an iteration; None if stopped."""

FAILED = "callbacks_failed"
MAX_ADDED = 100
"""Names that the callbacks of an attempt may add to its metrics: each becomes a curve that is kept."""
_MAX_NAME, _MAX_REASON = 64, 500
_NAME = re.compile(r"[A-Za-z][\w.]*", re.ASCII)
_RESERVED = frozenset({"sha256"})  # of a line's digest


class Callbacks:
    """The callbacks of one attempt; a `TrainingRun` to each of them.

    Args:
        first: the iteration that the attempt goes on with.
        play: plays the episodes of an evaluation.

    Attributes:
        stopped: why the run is to finish before its last iteration; "": it is not.

    Raises:
        PluginError: one is not installed, or cannot be made.
        ConfigError: it lacks something.
    """

    def __init__(
        self, config: RunConfig, owner: Ownership, counters: Counters, *, first: int, play: Play
    ) -> None:
        self.config, self.first, self.stopped = config, first, ""
        self._owner, self._counters, self._play = owner, counters, play
        self._records = [r for r in owner.folder.metrics() if r["iteration"] < first]
        self._update: UpdateEnd | None = None
        self._added: dict[str, float] = {}
        self._names: set[str] = set()
        self._evaluating = False
        run: TrainingRun = self
        self._all: list[tuple[str, Callback]] = []
        for name in config.callback_names:
            with settings_kept():
                self._all.append((name, plugins.find(plugins.CALLBACKS, name).call(run)))
            log.info("callback %s", name)

    @property
    def folder(self) -> Path:
        return self._owner.folder.path

    @property
    def records(self) -> tuple[Mapping[str, object], ...]:
        return tuple(deepcopy(self._records))

    def add(self, name: str, value: float) -> None:
        if self._update is None:
            raise RuntimeError(f"{name} can be added to the metrics at an update's end alone")
        if not _NAME.fullmatch(name) or len(name) > _MAX_NAME or name in _RESERVED:
            raise ValueError(f"{name[:_MAX_NAME]!r} is no metric's name: letters, digits, _ and .")
        if name in self._update.record or name in self._added:
            raise ValueError(f"the metrics have {name} already")
        if not isfinite(value):
            raise ValueError(f"{name} = {value}: must be a finite number")
        if name not in self._names and len(self._names) >= MAX_ADDED:
            raise ValueError(f"{name} is one too many: callbacks add at most {MAX_ADDED} metrics")
        self._names.add(name)
        self._added[name] = float(value)

    def evaluate(self, episodes: int) -> EvaluationEnd | None:
        if self._update is None:
            raise RuntimeError("policies are evaluated at an update's end alone")
        if episodes < 1:
            raise ValueError(f"episodes = {episodes}: must be 1 or more")
        if self._evaluating:  # by one that is told of an evaluation, which would go on for ever
            raise RuntimeError("an evaluation is going on")
        self._evaluating = True
        try:
            done = self._play(self._update.iteration, self._update.weights, episodes)
            if done is not None:
                self._call("evaluation", done.iteration, lambda one: one.on_evaluation_end(done))
            return done
        finally:
            self._evaluating = False

    def keep_best(self, version: int, metric: str, value: float) -> None:
        self._owner.write_best(version, metric, value)

    def stop(self, reason: str) -> None:
        said = " ".join(reason.split())[:_MAX_REASON]
        if not said:
            raise ValueError("to stop a run needs a reason that people can read")
        self.stopped = self.stopped or said

    def collection_end(self, end: CollectionEnd) -> None:
        """Tells all of them."""
        self._call("collection", end.iteration, lambda one: one.on_collection_end(end))

    def update_end(
        self, iteration: int, record: Mapping[str, object], weights: Weights
    ) -> dict[str, float]:
        """Tells all of them, and returns what they add to the record."""
        self._update, self._added = UpdateEnd(iteration, record, weights), {}
        try:
            self._call(
                "update",
                iteration,
                lambda one: one.on_update_end(
                    UpdateEnd(iteration, deepcopy(dict(record)) | self._added, weights)
                ),
            )
            return self._added
        finally:
            self._update = None

    def run_end(self, *, finished: bool, reason: str) -> None:
        """Tells all of them that the attempt is over, and why before the last iteration."""
        end = RunEnd(finished, reason)
        self._call("run", None, lambda one: one.on_run_end(end))

    def _call(self, what: str, iteration: int | None, call: Callable[[Callback], None]) -> None:
        at = "" if iteration is None else f", iteration {iteration}"
        for name, callback in self._all:
            try:
                with settings_kept():
                    call(callback)
            except (Exception, SystemExit) as error:  # whatever others wrote ends no training
                doing = f"callback {name!r} at the end of the {what}{at}"
                self._counters.refuse(FAILED, f"{doing}: {one_line(error)}")
                log.debug("%s", doing, exc_info=error)
