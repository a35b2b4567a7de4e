"""A policy in a far process: images go to it over Zenoh and actions come back, as to the paper's server.

`python -m bpn.reproduce.remote_policy --connect ENDPOINT` is the far process. It reads the client's clock, so both
are on one machine: what a network would add is not in its numbers.
"""

import argparse
import struct
import threading
import time
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from bpn_edge.kernel import Kernel, load
from bpn_edge.policy import softmax_action
from bpn_shared.bnn.blob import WeightBlob
from bpn_shared.bnn.weights import Weights
from bpn_shared.bus.latest import DirectSubscriber, LatestPublisher
from bpn_shared.bus.session import DEFAULT_ENDPOINT, Bus, prepare_process
from bpn_shared.runtime.service import end_with_supervisor, set_up_logging, stop_on_signals
from bpn_shared.spec.config import RunConfig
from bpn_shared.spec.observation import stack

CONFIG = RunConfig.for_task("pan_tilt")
"""The network of the paper's section VI."""
IMAGES, ACTIONS = "bpn/far/image", "bpn/far/action"

Frame = npt.NDArray[np.uint8]

_HEADER = struct.Struct("<Q")  # number of the image
_ANSWER = struct.Struct(
    "<QQQB"
)  # number of the image, when it came, when the action left, the action


class Breakdown(NamedTuple):
    """Where the time from an image to its action went, in microseconds."""

    send: float
    compute: float
    receive: float


class Policy:
    """What any computer does with an image: stacks it on the one before, infers, draws an action."""

    def __init__(self, kernel: Kernel, weights: Weights) -> None:
        self._kernel, self._scale = kernel, weights.scale
        self._kernel.load(weights)
        self._before = np.zeros(CONFIG.task_spec.frame_shape, np.uint8)

    def act(self, frame: Frame) -> int:
        """The action for the newest frame uint8[c, 84, 84]."""
        observation = stack(
            [self._before, frame], 1, CONFIG.task_spec.frames_stacked, difference=False
        )
        self._before = frame
        return softmax_action(self._kernel.run(observation), self._scale, CONFIG.beta, 0.5)


def binarized_policy(kernel: str) -> Policy:
    """A policy with random signs: no time depends on them."""
    return Policy(load(kernel), WeightBlob.random(CONFIG.network, np.random.default_rng(0)))


class FarPolicy:
    """The far process: answers every image on the network thread, as an edge does."""

    def __init__(self, bus: Bus, policy: Policy) -> None:
        self._policy = policy
        self._actions = LatestPublisher(bus, ACTIONS, "action")
        self._images = DirectSubscriber(bus, IMAGES, self._answer)

    def _answer(self, header: bytes, pixels: bytes, t_receive_ns: int) -> None:
        (number,) = _HEADER.unpack(header)
        frame = np.frombuffer(pixels, np.uint8).reshape(CONFIG.task_spec.frame_shape)
        action = self._policy.act(frame)
        self._actions.put(_ANSWER.pack(number, t_receive_ns, time.monotonic_ns(), action))


class FarClient:
    """The robot's end."""

    def __init__(self, bus: Bus) -> None:
        self._images = LatestPublisher(bus, IMAGES, "frame")
        self._answered = threading.Event()
        self._answer, self._number = b"", 0
        self._arrived_ns = 0
        self._actions = DirectSubscriber(bus, ACTIONS, self._receive)

    def _receive(self, _header: bytes, answer: bytes, t_receive_ns: int) -> None:
        self._answer, self._arrived_ns = answer, t_receive_ns
        self._answered.set()

    def ask(self, frame: Frame, timeout_s: float) -> Breakdown | None:
        """Sends an image and waits for its action; None if that does not come in time."""
        self._number += 1
        self._answered.clear()
        sent_ns = time.monotonic_ns()
        self._images.put(frame.tobytes(), _HEADER.pack(self._number))
        if not self._answered.wait(timeout_s):
            return None
        number, came_ns, left_ns, _ = _ANSWER.unpack(self._answer)
        if number != self._number:
            return None  # late: of an image before
        times_ns = (came_ns - sent_ns, left_ns - came_ns, self._arrived_ns - left_ns)
        return Breakdown(*(time_ns / 1e3 for time_ns in times_ns))


def main(argv: list[str] | None = None) -> int:
    """Answers images until stopped."""
    parser = argparse.ArgumentParser(prog="bpn.reproduce.remote_policy", description=__doc__)
    parser.add_argument("--connect", default=DEFAULT_ENDPOINT, help="the router's endpoint")
    options = parser.parse_args(argv)
    set_up_logging("far")
    prepare_process()
    stop = stop_on_signals()
    end_with_supervisor()
    with Bus(options.connect, stop=stop) as bus:
        far = FarPolicy(bus, binarized_policy("native"))
        stop.wait()
        del far
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
