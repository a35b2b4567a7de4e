"""Whether a run makes progress, and if not, why: from its services' reports and what others know of it.

Progress is an episode that the learner stored, an epoch of its update, an iteration on disk, or steps that an edge
played; the latter only as many as two episodes have, because an edge that plays the same episode again and again
gets nowhere.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Literal, NamedTuple, get_args

from bpn_shared.messages.telemetry import Telemetry

STALLED_AFTER_S = 30.0
"""Without progress for so long a run is stalled."""
SILENT_AFTER_S = 5.0
"""Without a report for so long a service is silent: it reports every second."""

EPISODES_STORED, EPOCHS_DONE, STEPS_PLAYED = "episodes_stored", "epochs_done", "steps_played"
"""Counters that tell of progress: the first two are the learner's, the last one is the edge's."""

_MOST_REASONS = 4
_MOST_REFUSED = 2
_KINDS = ("learner", "edge", "robot_sim")


CauseKind = Literal[
    "router", "queue", "owner", "silent", "service", "place", "refusal", "worker", "disk", "computing", "nobody"
]  # fmt: skip
"""Why a run stands still, for who counts: the router is not reached; it has no learner yet; its folder is held by
somebody unknown; a service of it is silent, or waits for something; robots or edges are missing; a service refused
something; workers are there and cannot be used; the disk; its learner computes; nobody reports from it."""
CAUSE_KINDS: tuple[CauseKind, ...] = get_args(CauseKind)


class Cause(NamedTuple):
    """One of the reasons why a run stands still: its kind, and a sentence for people."""

    kind: CauseKind
    text: str


def sentence(causes: Iterable[Cause]) -> str:
    """What a run waits for, for people. It stays the same while the causes do."""
    return "; ".join(cause.text for cause in causes)


class Stall(NamedTuple):
    """A run makes no progress: for how long, and why."""

    for_s: float
    causes: tuple[Cause, ...]

    @property
    def reason(self) -> str:
        """Why, for people."""
        return sentence(self.causes)


@dataclass(frozen=True)
class Circumstances:
    """What is known of a run beside its services' reports; a sentence each, empty where nothing is to be said.

    Attributes:
        router: the router cannot be reached.
        queue: why it has no learner.
        owner: who holds its folder, of whom no report came.
        lacking: places that nobody has.
        refused: workers that are there and cannot be used.
        disk: what is wrong with the disk.
    """

    router: str = ""
    queue: str = ""
    owner: str = ""
    lacking: tuple[str, ...] = ()
    refused: tuple[str, ...] = ()
    disk: str = ""


@dataclass
class _Heard:
    report: Telemetry
    at_s: float
    counted: dict[str, int]
    """When the run last made progress."""
    steps: int = field(default=0)
    """Since then."""


class Watchdog:
    """Watches one run. Times are seconds of any clock that does not jump; not thread-safe.

    Args:
        episode_steps: the most steps that an episode of the run has.
        now_s: since when it is watched.
    """

    def __init__(self, episode_steps: int, now_s: float) -> None:
        self._episode_steps = episode_steps
        self._since_s = now_s
        self._heard: dict[str, _Heard] = {}
        self._iteration = 0

    def begin(self, now_s: float) -> None:
        """The run is wanted anew."""
        self._since_s = now_s

    def hear(self, report: Telemetry, now_s: float) -> None:
        """A service that works on the run tells how it is."""
        if report.kind not in _KINDS:
            return
        known = self._heard.get(report.worker)
        if known is None and _is_first_learner(report):  # in another's place
            self._heard = {
                worker: heard
                for worker, heard in self._heard.items()
                if not _is_first_learner(heard.report)
            }
        if known is None:
            self._heard[report.worker] = _Heard(report, now_s, report.counters)
            return
        before, known.report, known.at_s = known.report, report, now_s
        if any(_gained(name, before, report) for name in (EPISODES_STORED, EPOCHS_DONE)):
            self._progressed(now_s)
        elif (steps := _gained(STEPS_PLAYED, before, report)) > 0:
            if known.steps < 2 * self._episode_steps:
                self._since_s = now_s
            known.steps += steps

    def iterated(self, iteration: int, now_s: float) -> None:
        """So many iterations are on disk."""
        if iteration > self._iteration:
            self._iteration = iteration
            self._progressed(now_s)

    def gone(self, worker: str) -> None:
        """A service works on the run no more."""
        self._heard.pop(worker, None)

    def _progressed(self, now_s: float) -> None:
        self._since_s = now_s
        for heard in self._heard.values():
            heard.steps, heard.counted = 0, heard.report.counters

    def silent_s(self, worker: str, now_s: float) -> float | None:
        """How long ago the last report of a service came; None: there was none."""
        heard = self._heard.get(worker)
        return None if heard is None else now_s - heard.at_s

    def stall(self, now_s: float, around: Circumstances) -> Stall | None:
        """How long the run has made no progress, and why; None: that is not yet long."""
        for_s = now_s - self._since_s
        return Stall(for_s, self.causes(now_s, around)) if for_s >= STALLED_AFTER_S else None

    def causes(self, now_s: float, around: Circumstances) -> tuple[Cause, ...]:
        """What the run waits for."""
        if around.router:
            return (Cause("router", around.router),)
        causes = [*self._causes(now_s, around)][:_MOST_REASONS]
        causes += [Cause("worker", why) for why in around.refused[:_MOST_REFUSED]]
        if around.disk:
            causes.append(Cause("disk", around.disk))
        if not causes:
            learner = Cause("computing", "its learner computes")
            causes = [learner if self._learner() else Cause("nobody", "nobody reports from it")]
        return tuple(causes)

    def _learner(self) -> _Heard | None:
        return next((h for h in self._heard.values() if _is_first_learner(h.report)), None)

    def _causes(self, now_s: float, around: Circumstances) -> Iterator[Cause]:
        learner = self._learner()
        if learner is not None and now_s - learner.at_s > SILENT_AFTER_S:
            since = _time(learner.report)
            yield Cause("silent", f"its owner {learner.report.worker} is silent since {since}")
        if learner is None and around.owner:
            yield Cause("owner", around.owner)
        elif around.queue:
            yield Cause("queue", around.queue)
        ordered = sorted(
            self._heard.values(), key=lambda h: (_KINDS.index(h.report.kind), h.report.slot or 0)
        )
        fresh = [heard for heard in ordered if now_s - heard.at_s <= SILENT_AFTER_S]
        for heard in fresh:
            if heard.report.waiting_for:
                waits = f"{_name(heard.report)} waits for {heard.report.waiting_for}"
                yield Cause("service", waits)
        for heard in ordered:
            if heard not in fresh and heard is not learner:
                silent = f"{_name(heard.report)} is silent since {_time(heard.report)}"
                yield Cause("silent", silent)
        if learner is not None:
            yield from (Cause("place", what) for what in around.lacking)
        for heard in fresh:
            if (refusal := _newest_refusal(heard)) is not None:
                yield Cause("refusal", f"{_name(heard.report)} refused: {refusal}")


def _gained(counter: str, before: Telemetry, now: Telemetry) -> int:
    return now.counters.get(counter, 0) - before.counters.get(counter, 0)


def _newest_refusal(heard: _Heard) -> str | None:
    """Why it refused something since the run last made progress."""
    counters = heard.report.counters
    for name, reason in reversed(heard.report.refusals.items()):
        if counters.get(name, 0) > heard.counted.get(name, 0):
            return reason
    return None


def _is_first_learner(report: Telemetry) -> bool:
    return report.kind == "learner" and not report.slot


def _name(report: Telemetry) -> str:
    if report.kind == "learner":
        return f"learner {report.slot}" if report.slot else "the learner"
    return f"{report.kind.removesuffix('_sim')} {report.slot}"


def _time(report: Telemetry) -> str:
    """When it last reported: of the same silence the same text."""
    return datetime.fromtimestamp(report.time_ns // 10**9, UTC).strftime("%H:%M:%S UTC")
