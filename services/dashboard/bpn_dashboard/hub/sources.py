"""Where topics come from: each source is opened for the first who looks, and closed after the last."""

import asyncio
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple
from uuid import UUID

import orjson

from bpn_dashboard.hub import log_tail
from bpn_dashboard.hub.channel import CameraFrame
from bpn_dashboard.hub.protocol import ProtocolError
from bpn_dashboard.hub.topics import DELIVERY, Kind, Topic
from bpn_dashboard.hub.topology import Topology
from bpn_shared.bus import keys
from bpn_shared.bus.session import Bus
from bpn_shared.bus.watch import Subscriber
from bpn_shared.counters import Counters
from bpn_shared.messages.base import MessageError
from bpn_shared.messages.decision import Decision
from bpn_shared.messages.metrics import MetricsBatch
from bpn_shared.messages.preview import PreviewHeader, check_pixels
from bpn_shared.runs.folder import RunFolder

Put = Callable[[Any], None]
Close = Callable[[], None]
Content = bytes | CameraFrame


class Source(NamedTuple):
    """How a kind of topic begins, and what its messages are made of.

    Attributes:
        open: starts putting messages, and returns what stops it.
        decode: from what was put to what is sent, on the event loop.
    """

    open: Callable[[Topic, Put], Close]
    decode: Callable[[Any], Content | None]


def sources(bus: Bus, runs_dir: Path, topology: Topology, counters: Counters) -> dict[Kind, Source]:
    """The source of every kind of topic. What does not decode is counted as `live_refused`."""

    def checked(decode: Callable[[Any], Content]) -> Callable[[Any], Content | None]:
        def decode_or_refuse(raw: Any) -> Content | None:
            try:
                return decode(raw)
            except MessageError as error:
                counters.refuse("live_refused", str(error))
                return None

        return decode_or_refuse

    def watch(key: Callable[[Topic], str]) -> Callable[[Topic, Put], Close]:
        def open_watch(topic: Topic, put: Put) -> Close:
            return Subscriber(bus, key(topic), lambda header, payload: put((header, payload))).close

        return open_watch

    def open_logs(topic: Topic, put: Put) -> Close:
        folder = RunFolder(runs_dir / str(topic.run))
        if not folder.path.is_dir():
            raise ProtocolError(f"no run {topic.run} in {runs_dir}")
        return log_tail.follow(folder.logs, put, runs_dir)

    def open_topology(_topic: Topic, put: Put) -> Close:
        return _every(1 / DELIVERY["topology"].rate_hz, lambda: put(topology))

    def in_slot(key: Callable[[UUID, int, str], str]) -> Callable[[Topic], str]:
        return lambda topic: key(_run(topic), topic.slot or 0, keys.ANY)

    def metrics_key(topic: Topic) -> str:
        return keys.metrics(_run(topic), "*", "*")

    published = Source(lambda _topic, _put: lambda: None, orjson.dumps)
    return {
        "camera": Source(watch(in_slot(keys.preview)), checked(_camera_frame)),
        "actions": Source(watch(in_slot(keys.decision)), checked(_decision)),
        "metrics": Source(watch(metrics_key), checked(_metrics)),
        "logs": Source(open_logs, lambda line: line),
        "topology": Source(open_topology, lambda now: now.snapshot().model_dump_json().encode()),
        "runs": published,
        "alerts": published,
    }


def _run(topic: Topic) -> UUID:
    assert topic.run is not None  # its form has one
    return topic.run


def _camera_frame(message: tuple[bytes, bytes]) -> CameraFrame:
    attachment, pixels = message
    header = PreviewHeader.decode(attachment)
    check_pixels(header, pixels)
    return CameraFrame(
        t_capture_unix_s=header.t_capture_unix_ns / 1e9,
        channels=header.channels,
        height_px=header.frame_px,
        width_px=header.frame_px,
        frames_stacked=header.frames_stacked,
        pixels=pixels,
    )


def _decision(message: tuple[bytes, bytes]) -> bytes:
    decision = Decision.decode(message[1])
    return orjson.dumps(
        {
            **decision.model_dump(exclude={"inference_ns", "edge_ns", "time_ns"}),
            "preferences": [decision.scale * output for output in decision.outputs],
            "inference_us": decision.inference_ns / 1e3,
            "edge_us": decision.edge_ns / 1e3,
            "time_unix_s": decision.time_ns / 1e9,
        }
    )


def _metrics(message: tuple[bytes, bytes]) -> bytes:
    points = [
        {"name": p.name, "step": p.step, "value": p.value, "time_unix_s": p.time_ns / 1e9}
        for p in MetricsBatch.decode(message[1]).points
    ]
    return orjson.dumps({"points": points})


def _every(period_s: float, action: Callable[[], None]) -> Close:
    """Calls `action` now and every period until the returned function is called."""
    loop = asyncio.get_running_loop()
    timer: asyncio.TimerHandle

    def tick() -> None:
        nonlocal timer
        action()
        timer = loop.call_later(period_s, tick)

    def stop() -> None:
        timer.cancel()

    tick()
    return stop
