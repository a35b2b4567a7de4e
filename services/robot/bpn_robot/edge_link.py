"""The robot's end of the two streams: frames out, actions in, by the router and past it."""

import threading
from functools import partial

from bpn_shared.bus import keys
from bpn_shared.bus.latest import LatestPublisher, LatestSubscriber, Sample
from bpn_shared.bus.local_link import LocalServer
from bpn_shared.messages import action
from bpn_shared.runtime.worker import Worker


class EdgeLink:
    """Frames go past the router while their actions come past it, and else by the router too.

    So an edge on another machine, one that was replaced and one that does not answer any more are all alike: a
    frame that was sent again, or missed its action, goes both ways until an action comes past the router. The edge
    answers a frame that it gets twice as it did before.
    """

    def __init__(self, worker: Worker) -> None:
        place = worker.run, worker.slot, worker.site
        self._frames = LatestPublisher(worker.bus, keys.frame(*place), "frame")
        self._actions = LatestSubscriber(worker.bus, keys.action(*place))
        self._lock = threading.Lock()
        self._is_local = False
        """Whether the edge is known to be reached past the router."""
        self._unanswered: tuple[bytes, bytes] | None = None
        self._local = LocalServer(
            worker.bus,
            partial(keys.local_link, *place),
            keys.frame(*place),
            keys.action(*place),
            attachment_bytes=0,
            max_bytes=action.BYTES,
            on_message=self._receive,
            on_lost=self._lost,
        )

    def send(self, header: bytes, pixels: bytes) -> None:
        """Sends a frame, never blocking."""
        self._unanswered = header, pixels
        if not (self._local.put(header, pixels) and self._is_local):
            self._frames.put(pixels, header)

    def take(self, timeout_s: float) -> Sample | None:
        """The newest action that nobody took yet (`LatestSubscriber.take`)."""
        return self._actions.take(timeout_s)

    def wake(self) -> None:
        """Makes `take` return at once."""
        self._actions.wake()

    def answered(self, sample: Sample) -> None:
        """The sample was the action for the newest frame."""
        with self._lock:
            self._unanswered, self._is_local = None, sample.is_local

    def doubt(self) -> None:
        """The action for the newest frame did not come: from now on frames go by the router too."""
        with self._lock:
            self._is_local = False

    def _receive(self, attachment: bytes, payload: bytes, t_receive_ns: int) -> None:
        self._actions.put(Sample(attachment, payload, t_receive_ns, is_local=True))

    def _lost(self) -> None:
        """The way past the router has ended, and maybe a frame with it."""
        with self._lock:
            self._is_local, unanswered = False, self._unanswered
        if unanswered is not None:
            header, pixels = unanswered
            self._frames.put(pixels, header)

    def close(self) -> None:
        """Ends the way past the router."""
        self._local.close()
