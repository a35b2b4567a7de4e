"""The edge's end of the two streams and the reset to its robot."""

import math
import threading
from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from bpn_shared.bus import keys
from bpn_shared.bus.latest import DirectSubscriber, LatestPublisher
from bpn_shared.bus.local_link import LocalClient
from bpn_shared.bus.local_socket import LocalConnection
from bpn_shared.closing import Closing
from bpn_shared.messages.action import Action
from bpn_shared.messages.base import MessageError
from bpn_shared.messages.control import Reset, ResetReply
from bpn_shared.messages.frame import HEADER_BYTES, FrameHeader, decode_frame
from bpn_shared.runtime.worker import Worker
from bpn_shared.spec.tasks import TaskSpec

_RESET_TIMEOUT_S = 1.0

OnFrame = Callable[[FrameHeader, npt.NDArray[np.uint8], int], None]
"""Takes a frame: header, pixels uint8[c, rows, columns], when it arrived (monotonic ns)."""


class RobotLink(Closing):
    """Frames in, actions out, for the robot of this worker's slot.

    Frames come by the router, and past it where the robot is on this machine; an action goes the way that its
    frame came.

    Args:
        past_router: whether a shorter way than by the router is looked for.
    """

    def __init__(self, worker: Worker, task: TaskSpec, *, past_router: bool = True) -> None:
        self._worker = worker
        self._task = task
        self._on_frame: OnFrame | None = None
        self._taking = threading.Lock()
        self._came_by: LocalConnection | None = None
        """The way of the frame that is being answered; None: by the router."""
        place = worker.run, worker.slot, worker.site
        self._reset_key = keys.reset(*place)
        self._actions = LatestPublisher(worker.bus, keys.action(*place), "action")
        self._sent = worker.bus.traffic.sent(keys.action(*place))
        self._frames = DirectSubscriber(
            worker.bus,
            keys.frame(*place),
            lambda *message: self._receive(None, *message),
        )
        self._local = (
            LocalClient(
                worker.bus,
                keys.local_link(*place, keys.ANY),
                keys.frame(*place),
                attachment_bytes=HEADER_BYTES,
                max_bytes=HEADER_BYTES + math.prod(task.frame_shape),
                on_message=self._receive,
            )
            if past_router
            else None
        )

    def listen(self, on_frame: OnFrame | None) -> None:
        """From now on frames go to `on_frame`, on a thread that receives; None: they go nowhere.

        Calls of it come one after the other. When this returns, no call of what was there before is under way.
        """
        with self._taking:
            self._on_frame = on_frame

    def _receive(
        self, came_by: LocalConnection | None, attachment: bytes, payload: bytes, t_receive_ns: int
    ) -> None:
        with self._taking:
            if self._on_frame is None:
                return
            try:
                header, pixels = decode_frame(attachment, payload, self._task.frame_shape)
            except MessageError as error:
                self._worker.counters.refuse("frames_refused", str(error))
                return
            self._came_by = came_by
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
        """Answers the frame that `on_frame` has been called with, within that call."""
        encoded = action.encode()
        if self._came_by is None or not self._came_by.put(b"", encoded):
            self._actions.put(encoded)
        else:
            self._sent.add(len(encoded))

    def close(self) -> None:
        """Takes in no more frames past the router."""
        if self._local is not None:
            self._local.close()
