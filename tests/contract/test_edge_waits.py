"""What an edge says while it has nothing to play, and how long it waits for its robot."""

from collections.abc import Callable

from learner_side import LearnerSide
from loop_parts import Running

from bpn_edge import service as edge
from bpn_shared.bus.session import Bus
from bpn_shared.messages.control import Assignment
from bpn_shared.spec.config import RunConfig

CONFIG = RunConfig.for_task("reaching", hidden_units=16, steps=3)


def test_it_waits_for_what_the_learner_says_and_ends_when_that_is_done(
    open_bus: Callable[[], Bus],
    running: Callable[..., Running],
    wait_for: Callable[..., None],
) -> None:
    told = [Assignment(status="wait", reason="the policy update")]
    learner = LearnerSide(open_bus(), CONFIG)
    learner.assignment = lambda: told[-1]  # type: ignore[method-assign]
    learner.publish(1, 7)
    service = running("edge", edge.serve, CONFIG)
    wait_for(lambda: service.worker.waiting.snapshot()[0] == "the policy update", "the reason")
    wait_for(service.worker.weights.snapshot, "the weights")
    (event, mark), *others = service.worker.weights.snapshot().items()
    assert (event, mark.attempt, mark.version, others) == ("loaded", 1, 7, [])
    told.append(Assignment(status="finished", reason="all iterations are done"))
    wait_for(lambda: not service.alive, "its end")
