"""One topic: a bounded place between those who publish, on any thread, and those who look, on the event loop."""

import asyncio
import contextlib
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, NamedTuple, TypeVar

from bpn_dashboard.hub.topics import Topic

Raw = TypeVar("Raw")

MAX_KEPT_BYTES = 4 * 1024 * 1024
"""Of one topic, however few messages that is; but never less than the newest."""


class CameraFrame(NamedTuple):
    """An observation as the robot's network sees it, uint8[channels, height, width]."""

    t_capture_unix_s: float
    channels: int
    height_px: int
    width_px: int
    frames_stacked: int
    pixels: bytes


@dataclass(frozen=True, slots=True)
class Item:
    """A message of a topic: JSON or a frame; `t_unix_s` is when it came."""

    seq: int
    t_unix_s: float
    content: bytes | CameraFrame

    @property
    def size_bytes(self) -> int:
        pixels = self.content.pixels if isinstance(self.content, CameraFrame) else self.content
        return len(pixels)


class Channel(Generic[Raw]):
    """The newest `kept` messages of a topic, or `MAX_KEPT_BYTES` of them, numbered.

    `put` may be called on any thread and never waits; all else belongs to the event loop. Both the place
    where messages arrive and the one where they are kept are bounded: what does not fit is gone, and its
    numbers are missing.

    Args:
        decode: from what was put to its content; None: refused, nothing is published.
    """

    def __init__(
        self,
        topic: Topic,
        kept: int,
        decode: Callable[[Raw], bytes | CameraFrame | None],
        loop: asyncio.AbstractEventLoop,
    ) -> None:
        self.topic = topic
        self._decode, self._loop = decode, loop
        self._lock = threading.Lock()
        self._arrivals: deque[tuple[float, Raw]] = deque(maxlen=kept)
        self._overflow = 0
        self._announced = False
        self._items: deque[Item] = deque(maxlen=kept)
        self._kept_bytes = 0
        self._seq = 0
        self._listeners: set[Callable[[], None]] = set()

    def put(self, raw: Raw) -> None:
        """Publishes a message."""
        arrival = time.time(), raw
        with self._lock:
            self._overflow += len(self._arrivals) == self._arrivals.maxlen
            self._arrivals.append(arrival)
            if self._announced:
                return
            self._announced = True
        with contextlib.suppress(RuntimeError):  # the loop is closed: nobody looks any more
            self._loop.call_soon_threadsafe(self._take)

    def _take(self) -> None:
        with self._lock:
            arrivals, self._announced = list(self._arrivals), False
            self._arrivals.clear()
            self._seq += self._overflow
            self._overflow = 0
        for t_unix_s, raw in arrivals:
            content = self._decode(raw)
            if content is not None:
                self._seq += 1
                self._keep(Item(self._seq, t_unix_s, content))
        for listener in tuple(self._listeners):
            listener()

    def _keep(self, item: Item) -> None:
        items = self._items
        self._kept_bytes += item.size_bytes
        while items and (len(items) == items.maxlen or self._kept_bytes > MAX_KEPT_BYTES):
            self._kept_bytes -= items.popleft().size_bytes
        items.append(item)

    @property
    def seq(self) -> int:
        """The number of the newest item; 0 before the first."""
        return self._items[-1].seq if self._items else 0

    def after(self, seq: int, limit: int) -> list[Item]:
        """The oldest kept items whose number is higher, at most `limit`."""
        newer: list[Item] = []
        for item in reversed(self._items):
            if item.seq <= seq:
                break
            newer.append(item)
        return newer[::-1][:limit]

    def listen(self, listener: Callable[[], None]) -> None:
        """From now on `listener` is called whenever something came."""
        self._listeners.add(listener)

    def unlisten(self, listener: Callable[[], None]) -> None:
        self._listeners.discard(listener)
