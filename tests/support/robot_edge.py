"""An edge as a test speaks it: it begins episodes, keeps the frames that come, and answers when it is told to."""

import threading

import numpy as np
import pytest
from learner_side import RUN

from bpn_shared.bus import keys
from bpn_shared.bus.latest import DirectSubscriber, LatestPublisher
from bpn_shared.bus.session import Bus
from bpn_shared.messages.action import Action
from bpn_shared.messages.control import Reset, ResetReply
from bpn_shared.messages.frame import FrameHeader, decode_frame
from bpn_shared.runtime.ask import ask
from bpn_shared.spec.config import RunConfig
from bpn_shared.waiting import WaitStatus


class EdgeSide:
    """Begins episodes, keeps the frames that come, and answers when it is told to."""

    def __init__(self, bus: Bus, config: RunConfig) -> None:
        self._bus, self._config = bus, config
        self._news = threading.Condition()
        self._resets = 100
        self.frames: list[tuple[FrameHeader, np.ndarray]] = []
        self._actions = LatestPublisher(bus, keys.action(RUN, 0), "action")
        self._subscriber = DirectSubscriber(bus, keys.frame(RUN, 0), self._take)

    def _take(self, attachment: bytes, payload: bytes, _t_ns: int) -> None:
        frame = decode_frame(attachment, payload, self._config.task_spec.frame_shape)
        with self._news:
            self.frames.append(frame)
            self._news.notify_all()

    def reset(self, reset_id: int, seed: int = 3, episode: int = 1) -> None:
        body = Reset(iteration=2, episode=episode, seed=seed, reset_id=reset_id).encode()
        reply = ask(
            self._bus, keys.reset(RUN, 0), body, ResetReply.decode, stop=threading.Event(),
            waiting=WaitStatus(), waiting_for="the robot", on_refusal=pytest.fail,
        )  # fmt: skip
        assert reply == ResetReply(reset_id=reset_id)

    def new_reset(self) -> int:
        """Begins an episode under a new id, which is its seed too, and returns that."""
        self._resets += 1
        self.reset(self._resets, seed=self._resets)
        return self._resets

    def frame(self, step: int, reset_id: int, count: int = 1) -> tuple[FrameHeader, np.ndarray]:
        """That frame, as soon as it has come so often."""

        def found() -> list[tuple[FrameHeader, np.ndarray]]:
            return [f for f in self.frames if (f[0].step, f[0].reset_id) == (step, reset_id)]

        with self._news:
            assert self._news.wait_for(lambda: len(found()) >= count, 60), f"no frame {step}"
            return found()[-1]

    def act(self, action: int, step: int, reset_id: int) -> None:
        self._actions.put(Action(action, step, 7, reset_id, 1, 1).encode())
