"""A server that has nothing but the live view, and who uses it: tabs, robots."""

import contextlib
import itertools
import json
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from uuid import UUID, uuid4

from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

from bpn_dashboard.hub.hub import Hub
from bpn_dashboard.hub.protocol import LiveFrame
from bpn_dashboard.hub.websocket import PATH
from bpn_shared.bus import keys
from bpn_shared.bus.latest import LatestPublisher
from bpn_shared.bus.session import Bus
from bpn_shared.counters import Counters
from bpn_shared.messages.preview import PreviewHeader

OpenBus = Callable[[], Bus]
WaitFor = Callable[..., None]
RUN = uuid4()
CAMERA = f"camera/{RUN}/0"


@dataclass
class Server:
    """A dashboard that has nothing but the live view."""

    runs_dir: Path
    port: int = 0
    hub: Hub | None = None
    owner: str | None = "somebody"
    counters: Counters = field(default_factory=Counters)

    @property
    def view(self) -> Hub:
        assert self.hub is not None
        return self.hub


class Tab:
    """A browser tab, as far as the protocol goes."""

    def __init__(self, server: Server, hello: bool = True, **options: Any) -> None:
        self._closing = contextlib.ExitStack()
        host = f"127.0.0.1:{server.port}"
        options = {"uri": f"ws://{host}{PATH}", "origin": f"http://{host}", **options}
        self.socket: ClientConnection = self._closing.enter_context(
            connect(compression=None, **options)
        )
        self._ids = itertools.count(1)
        if hello:
            self.say(op="hello", proto=1)
            self.welcome = self.hear()

    def close(self) -> None:
        self._closing.close()

    def say(self, **message: Any) -> None:
        self.socket.send(json.dumps(message))

    def subscribe(self, topic: str, **more: Any) -> int:
        subscription = next(self._ids)
        self.say(op="sub", id=subscription, topic=topic, **more)
        return subscription

    def hear(self, timeout_s: float = 20) -> Any:
        """The next message: a dict, or header and pixels."""
        message = self.socket.recv(timeout=timeout_s)
        return json.loads(message) if isinstance(message, str) else LiveFrame.decode(message)

    def silent(self) -> bool:
        """Nothing more has been sent: the answer to a ping is the next message."""
        self.say(op="ping", t=1.0)
        return bool(self.hear().get("op") == "pong")

    def closed_with(self) -> int | None:
        """The code that the server closes with, whatever it said before."""
        try:
            while True:
                self.hear()
        except ConnectionClosed as closed:
            return closed.rcvd.code if closed.rcvd else None


class Robot:
    """Sends previews as fast as it is told, with the step as the value of every pixel."""

    def __init__(self, bus: Bus, run: UUID = RUN, channels: int = 1) -> None:
        self._publisher = LatestPublisher(bus, keys.preview(run, 0), "frame")
        self._channels = channels
        self.step = 0

    def show(self) -> int:
        self.step += 1
        header = PreviewHeader(self._channels, 1, 0, 0, self.step, time.time_ns())
        pixels = bytes([self.step % 256]) * (84 * 84 * self._channels)
        self._publisher.put(pixels, header.encode())
        return self.step


def first_frame(tab: Tab, robot: Robot) -> tuple[LiveFrame, bytes]:
    """Shows frames until the subscription has reached the robot."""
    for _ in range(200):
        robot.show()
        with contextlib.suppress(TimeoutError):
            frame: tuple[LiveFrame, bytes] = tab.hear(0.1)
            return frame
    raise AssertionError("no frame came")
