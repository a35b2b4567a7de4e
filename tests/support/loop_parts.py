"""Edge and robot on threads of the test's own process, and a robot whose frames a test can bend."""

import threading
import time
from collections.abc import Callable

import numpy as np
from learner_side import RUN, LearnerSide

from bpn_edge import service as edge
from bpn_shared.bus import keys
from bpn_shared.bus.latest import LatestPublisher, LatestSubscriber
from bpn_shared.bus.requests import Responder
from bpn_shared.bus.session import Bus
from bpn_shared.counters import Counters
from bpn_shared.messages.action import Action
from bpn_shared.messages.control import Reset, ResetReply
from bpn_shared.messages.frame import FrameHeader, FrameKind
from bpn_shared.messages.lease import Role
from bpn_shared.runtime.worker import Worker
from bpn_shared.spec.config import RunConfig


class Running:
    """A service on a thread of this process."""

    def __init__(
        self, bus: Bus, kind: Role, serve: Callable[[Worker, RunConfig], int], config: RunConfig
    ) -> None:
        self.worker = Worker(
            kind=kind,
            id=f"{kind.replace('_', '-')}-1",
            bus=bus,
            stop=threading.Event(),
            run=RUN,
            slot=0,
        )
        self.status: list[int] = []
        self._thread = threading.Thread(
            target=lambda: self.status.append(serve(self.worker, config))
        )
        self._thread.start()

    @property
    def counters(self) -> dict[str, int]:
        return self.worker.counters.snapshot()

    @property
    def alive(self) -> bool:
        return self._thread.is_alive()

    def end(self) -> None:
        self.worker.stop.set()
        self._thread.join(60)
        assert self.status == [0]


Headers = Callable[[FrameHeader, int], FrameHeader]


class EvilRobot:
    """Plays the robot's part, but for what `bend` makes of its headers.

    Attributes:
        hears: whether actions reach it.
        forgets_at: the step at which it begins again, once, as one that was restarted.
    """

    def __init__(self, bus: Bus, config: RunConfig, bend: Headers) -> None:
        self._config, self.bend = config, bend
        self.hears, self.forgets_at = True, -1
        self._frames = LatestPublisher(bus, keys.frame(RUN, 0), "frame")
        self._actions = LatestSubscriber(bus, keys.action(RUN, 0))
        self._reset: Reset | None = None
        self._stop = threading.Event()
        self._responder = Responder(bus, keys.reset(RUN, 0), self._on_reset, Counters())
        self._thread = threading.Thread(target=self._play)
        self._thread.start()

    def _on_reset(self, body: bytes) -> bytes:
        self._reset = Reset.decode(body)
        self._actions.wake()
        return ResetReply(reset_id=self._reset.reset_id).encode()

    def leave(self) -> None:
        """Answers no reset any more."""
        self._responder.close()

    def _play(self) -> None:
        step, applied, mine, t_ns = 0, 255, None, 0
        while not self._stop.is_set():
            reset = self._reset
            if reset is not mine:
                mine, step, applied, t_ns = reset, 0, 255, time.monotonic_ns()
            if reset is not None:
                last = step == self._config.steps
                kind = FrameKind.FIRST if step == 0 else FrameKind.LAST if last else FrameKind.MID
                header = FrameHeader(
                    kind, reset.iteration, reset.episode, step, reset.reset_id, t_ns, applied, 1, 0,
                    reward=0.5,
                )  # fmt: skip
                header = self.bend(header, step)
                pixels = np.full((1, 84, 84), step, np.uint8).tobytes()
                self._frames.put(pixels, header.encode())
            sample = self._actions.take(0.1)
            if step == self.forgets_at:
                step, applied, self.forgets_at, t_ns = 0, 255, -1, time.monotonic_ns()
            elif sample is not None and mine is not None and self.hears:
                action = Action.decode(sample.payload, self._config.task_spec.actions)
                if (action.reset_id, action.step) == (mine.reset_id, step):
                    step, applied, t_ns = step + 1, action.action, time.monotonic_ns()

    def end(self) -> None:
        self._stop.set()
        self._thread.join(10)


def good(header: FrameHeader, _step: int) -> FrameHeader:
    """Bends nothing."""
    return header


class Scene:
    """An edge between a learner and a robot whose frames can be bent, each on a session of its own.

    Attributes:
        blob: the weights that the learner has published, as version 7.
    """

    def __init__(
        self,
        open_bus: Callable[[], Bus],
        running: Callable[..., Running],
        config: RunConfig,
        bend: Headers = good,
    ) -> None:
        self._running, self._config = running, config
        self.learner = LearnerSide(open_bus(), config)
        self.blob = self.learner.publish(1, 7)
        self.robot = EvilRobot(open_bus(), config, bend)

    def begin(self) -> Running:
        """Starts the edge."""
        return self._running("edge", edge.serve, self._config)

    def end(self) -> None:
        self.robot.end()
