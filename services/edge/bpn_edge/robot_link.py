"""The edge's end of the two streams and the reset to its robot."""

import threading
from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from bpn_shared.bus import keys
from bpn_shared.bus.latest import DirectSubscriber, LatestPublisher
from bpn_shared.messages.action import Action
from bpn_shared.messages.base import MessageError
from bpn_shared.messages.control import Reset, ResetReply
from bpn_shared.messages.frame import FrameHeader, decode_frame
from bpn_shared.runtime.worker import Worker
from bpn_shared.spec.tasks import TaskSpec

_RESET_TIMEOUT_S = 1.0

OnFrame = Callable[[FrameHeader, npt.NDArray[np.uint8], int], None]
"""Takes a frame: header, pixels uint8[c, rows, columns], when it arrived (monotonic ns)."""


class RobotLink:
    """Frames in, actions out, for the robot of this worker's slot."""

    def __init__(self, worker: Worker, task: TaskSpec) -> None:
        self._worker = worker
        self._task = task
        self._on_frame: OnFrame | None = None
        self._taking = threading.Lock()
        place = worker.run, worker.slot, worker.site
        self._reset_key = keys.reset(*place)
        self._actions = LatestPublisher(worker.bus, keys.action(*place), "action")
        self._frames = DirectSubscriber(worker.bus, keys.frame(*place), self._receive)

    def listen(self, on_frame: OnFrame | None) -> None:
        """From now on frames go to `on_frame`, on the network thread; None: they go nowhere.

        When this returns, no call of what was there before is under way.
        """
        with self._taking:
            self._on_frame = on_frame

    def _receive(self, attachment: bytes, payload: bytes, t_receive_ns: int) -> None:
        with self._taking:
            if self._on_frame is None:
                return
            try:
                header, pixels = decode_frame(attachment, payload, self._task.frame_shape)
            except MessageError as error:
                self._worker.counters.refuse("frames_refused", str(error))
                return
            self._on_frame(header, pixels, t_receive_ns)

    def reset(self, reset: Reset, *, meanwhile: Callable[[], object] = lambda: None) -> bool:
        """Tells the robot to begin an episode, again and again until it answers; False if stopped.

        Args:
            meanwhile: is called when it does not answer at once, as one that is gone.
        """
        worker = self._worker
        answer = worker.ask(
            self._reset_key,
            reset.encode(),
            ResetReply.decode,
            waiting_for=f"robot {worker.slot} to answer a reset",
            refused_as="resets_refused",
            timeout_s=_RESET_TIMEOUT_S,
            meanwhile=meanwhile,
        )
        return answer is not None

    def send(self, action: Action) -> None:
        self._actions.put(action.encode())
