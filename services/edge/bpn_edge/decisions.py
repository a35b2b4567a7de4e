"""What the policy decides, shown to whoever watches; the robot's action never waits for it."""

import time

from bpn_shared.bnn.outputs import Outputs
from bpn_shared.bus import keys
from bpn_shared.bus.sampled import SampledPublisher
from bpn_shared.messages.action import Action
from bpn_shared.messages.control import Assignment
from bpn_shared.messages.decision import Decision
from bpn_shared.runtime.worker import Worker

RATE_HZ = 20.0

_Noted = tuple[Assignment, Action, Outputs, int]


class DecisionFeed:
    """Publishes at most `RATE_HZ` decisions a second, and none while nobody watches.

    Attributes:
        scale: lambda of the running weights.
    """

    def __init__(self, worker: Worker) -> None:
        self.scale = 0.0
        self._publisher = SampledPublisher[_Noted](
            worker.bus,
            keys.decision(worker.run, worker.slot, worker.site),
            RATE_HZ,
            self._encode,
            worker.counters,
        )

    def note(self, assignment: Assignment, action: Action, outputs: Outputs) -> None:
        """Takes a decision whose action has been sent."""
        if self._publisher.has_subscribers:
            self._publisher.publish_latest((assignment, action, outputs, time.time_ns()))

    def _encode(self, noted: _Noted) -> tuple[bytes, None]:
        assignment, action, outputs, time_ns = noted
        decision = Decision(
            iteration=assignment.iteration,
            episode=assignment.episode,
            step=action.step,
            action=action.action,
            outputs=outputs.tolist(),
            scale=self.scale,
            weights_version=action.weights_version,
            inference_ns=action.inference_ns,
            edge_ns=action.edge_ns,
            time_ns=time_ns,
        )
        return decision.encode(), None

    def close(self) -> None:
        self._publisher.close()
