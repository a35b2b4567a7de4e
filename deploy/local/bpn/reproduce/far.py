"""A policy in a far process: images go to it over Zenoh, and actions come back (the paper's server).

`python -m bpn.reproduce.far --connect ENDPOINT` is the server. Its clock has to be the client's, so both run on
one machine: what a network adds to it is not in the numbers.
"""

import argparse
import struct
import threading
import time
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from bpn_edge.kernel import load
from bpn_edge.policy import softmax_action
from bpn_shared import keys
from bpn_shared.bnn.blob import WeightBlob
from bpn_shared.bnn.spec import NetworkSpec
from bpn_shared.bus.latest import DirectSubscriber, LatestPublisher
from bpn_shared.bus.session import DEFAULT_ENDPOINT, Bus
from bpn_shared.observation import stack
from bpn_shared.service import end_with_supervisor, set_up_logging, stop_on_signals
from bpn_shared.tasks import TASKS

TASK = TASKS["pan_tilt"]
SPEC: NetworkSpec = TASK.network(100)
"""The network of the paper's section VI."""
BETA = 3.0

_ANSWER = struct.Struct("<BxxxIQQ")  # action, number, received, done
_PATIENCE_S = 1.0


class Breakdown(NamedTuple):
    """Where the time from an image to its action went, in microseconds."""

    send: float
    compute: float
    receive: float


class Policy:
    """What every computer does with an image: stack it with the one before, infer, draw the action.

    The weights are random: the time does not depend on them.
    """

    def __init__(self, kernel: str = "native") -> None:
        self._blob = WeightBlob.random(SPEC, np.random.default_rng(0))
        self._kernel = load("golden" if kernel == "golden" else "native")
        self._kernel.load(self._blob)
        self._last = np.zeros(TASK.frame_shape, np.uint8)

    def act(self, frame: "np.typing.NDArray[np.uint8]") -> int:
        observation = stack([self._last, frame], 1, TASK.frames_stacked)
        self._last = frame
        return softmax_action(self._kernel.run(observation), self._blob.scale, BETA, 0.5)
