"""What a service tells about itself: collected where it happens, reported once a second and when asked."""

import os
import platform
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Literal
from uuid import UUID

import numpy as np
import numpy.typing as npt

from bpn_shared.bnn.weights import Weights
from bpn_shared.bus.traffic import Tally, Traffic
from bpn_shared.bus.x509 import Life
from bpn_shared.counters import Counters
from bpn_shared.messages.control import MAX_REASON
from bpn_shared.messages.telemetry import (
    CertificateLife,
    KeyTraffic,
    Percentiles,
    Telemetry,
    WeightsEvent,
    WeightsMark,
)
from bpn_shared.version import PROTOCOL, VERSION
from bpn_shared.waiting import WaitStatus

LATENCY_WINDOW_S = 10.0
_MAX_CHUNKS = 256
_MAX_REFUSALS = 20
_LEAST_CPU_PERIOD_S = 0.25
_STATM, _BOOT_ID = Path("/proc/self/statm"), Path("/proc/sys/kernel/random/boot_id")

Place = Callable[[], tuple[UUID | None, int | None]]
"""The run and the slot that a service works on now, if any."""


class Latencies:
    """Durations by name; of the last `LATENCY_WINDOW_S` seconds, and bounded. Safe across threads."""

    def __init__(self, now_s: Callable[[], float] = time.monotonic) -> None:
        self._now_s = now_s
        self._lock = threading.Lock()
        self._chunks: dict[str, deque[tuple[float, npt.NDArray[np.float64]]]] = {}

    def add(self, name: str, durations_us: npt.ArrayLike) -> None:
        """Notes durations, microseconds, that were measured just now."""
        values = np.atleast_1d(np.asarray(durations_us, np.float64))
        with self._lock:
            chunks = self._chunks.setdefault(name, deque(maxlen=_MAX_CHUNKS))
            chunks.append((self._now_s(), values))

    def snapshot(self) -> dict[str, Percentiles]:
        """Percentiles by name; names without a duration in the window are left out."""
        oldest_s = self._now_s() - LATENCY_WINDOW_S
        with self._lock:
            recent = {
                name: [values for t_s, values in chunks if t_s >= oldest_s]
                for name, chunks in self._chunks.items()
            }
        joined = {name: np.concatenate(arrays) for name, arrays in recent.items() if arrays}
        return {name: _percentiles(values) for name, values in joined.items() if len(values)}


def _percentiles(values_us: npt.NDArray[np.float64]) -> Percentiles:
    p50, p95, p99, top = (round(float(v), 2) for v in np.percentile(values_us, [50, 95, 99, 100]))
    return Percentiles(count=len(values_us), p50_us=p50, p95_us=p95, p99_us=p99, max_us=top)


class WeightsTimeline:
    """The newest weights that were published, loaded, made the running ones, and when."""

    def __init__(self) -> None:
        self._marks: dict[WeightsEvent, WeightsMark] = {}

    def record(self, event: WeightsEvent, weights: Weights) -> None:
        """Says that this happened just now."""
        mark = WeightsMark(attempt=weights.attempt, version=weights.version, time_ns=time.time_ns())
        self._marks = {**self._marks, event: mark}

    def forget(self) -> None:
        """Another run begins."""
        self._marks = {}

    def snapshot(self) -> Mapping[WeightsEvent, WeightsMark]:
        return self._marks


class ProcessUsage:
    """What this process takes of its machine (Linux; elsewhere memory is reported as 0)."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._wall_s, self._cpu_s = time.monotonic(), time.process_time()
        self._percent = 0.0

    def cpu_percent(self) -> float:
        """Of one core, since the last call; calls in short order get the same answer."""
        with self._lock:
            wall_s, cpu_s = time.monotonic(), time.process_time()
            if wall_s - self._wall_s >= _LEAST_CPU_PERIOD_S:
                self._percent = 100 * (cpu_s - self._cpu_s) / (wall_s - self._wall_s)
                self._wall_s, self._cpu_s = wall_s, cpu_s
            return round(self._percent, 1)

    def rss_bytes(self) -> int:
        """Resident memory."""
        if not _STATM.exists():
            return 0
        return int(_STATM.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


class Reporter:
    """Makes the reports of one service.

    Args:
        place: asked for every report: the run and slot that it works on may change.
        certificate: asked likewise: the life of its certificates on the bus, None without.
    """

    def __init__(
        self,
        kind: str,
        worker: str,
        place: Place,
        traffic: Traffic,
        *,
        waiting: WaitStatus,
        counters: Counters,
        latencies: Latencies,
        weights: WeightsTimeline,
        certificate: Callable[[], Life | None] = lambda: None,
    ) -> None:
        self._kind, self._worker, self._place = kind, worker, place
        self._traffic, self._waiting, self._counters = traffic, waiting, counters
        self._latencies, self._weights = latencies, weights
        self._certificate = certificate
        self._usage = ProcessUsage()
        self._start_s = time.monotonic()
        self._clock = monotonic_clock()

    def report(self) -> Telemetry:
        """How the service is now."""
        run, slot = self._place()
        waiting_for, waiting_s = self._waiting.snapshot()
        sent, received = self._traffic.snapshot()
        return Telemetry(
            kind=self._kind,
            worker=self._worker,
            run=None if run is None else str(run),
            slot=slot,
            host=platform.node(),
            clock=self._clock,
            pid=os.getpid(),
            time_ns=time.time_ns(),
            uptime_s=round(time.monotonic() - self._start_s, 1),
            waiting_for=waiting_for and waiting_for[:MAX_REASON],
            waiting_s=round(waiting_s, 3),
            cpu_percent=self._usage.cpu_percent(),
            rss_bytes=self._usage.rss_bytes(),
            counters=self._counters.snapshot(),
            weights=dict(self._weights.snapshot()),
            latencies=self._latencies.snapshot(),
            traffic=[
                *(_key_traffic(key, "sent", tally) for key, tally in sent.items()),
                *(_key_traffic(key, "received", tally) for key, tally in received.items()),
            ],
            refusals={
                name: reason[:MAX_REASON]
                for name, reason in list(self._counters.reasons().items())[-_MAX_REFUSALS:]
            },
            version=VERSION,
            protocol=PROTOCOL,
            certificate=_certificate_life(self._certificate()),
        )

    def answer(self, _request: bytes) -> bytes:
        """The report as JSON: the answer to a health request."""
        return self.report().model_dump_json().encode()


def _key_traffic(key: str, direction: Literal["sent", "received"], tally: Tally) -> KeyTraffic:
    return KeyTraffic(
        key=key,
        direction=direction,
        messages=tally.messages,
        bytes=tally.bytes,
        dropped=tally.dropped,
    )


def _certificate_life(life: Life | None) -> CertificateLife | None:
    if life is None:
        return None
    return CertificateLife(start_unix_s=life.start.timestamp(), end_unix_s=life.end.timestamp())


def monotonic_clock() -> str:
    """Names what CLOCK_MONOTONIC counts from: this boot of this kernel, which containers share."""
    return _BOOT_ID.read_text().strip() if _BOOT_ID.exists() else f"process-{os.getpid()}"
