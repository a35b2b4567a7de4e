"""Robot and edge past the router: the same episodes, whatever happens to the shorter way."""

import itertools
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest
from learner_side import RUN, LearnerSide
from loop_parts import Running

from bpn_edge import service as edge
from bpn_robot_sim import worker as robot_sim
from bpn_shared.bus import keys
from bpn_shared.bus.latest import DirectSubscriber
from bpn_shared.bus.local_socket import LocalConnection
from bpn_shared.bus.session import Bus
from bpn_shared.messages.episode import Episode
from bpn_shared.spec.config import RunConfig

LOCKSTEP = RunConfig.for_task("reaching", hidden_units=16, steps=12)
REALTIME = RunConfig.for_task("tracking", hidden_units=16, steps=12, pacing="realtime")
FRAMES = 13
"""Of an episode."""


class Loop:
    """A robot and its edge, each on a session of its own, and who sees what passes the router."""

    def __init__(
        self,
        open_bus: Callable[[], Bus],
        running: Callable[..., Running],
        config: RunConfig,
        **options: Any,
    ) -> None:
        self._bus = open_bus()
        self.learner = LearnerSide(self._bus, config)
        self.learner.publish(1, 7)
        self.seen_at_router = 0
        self._watching = DirectSubscriber(self._bus, keys.frame(RUN, 0), self._see)
        self.robot = running("robot_sim", robot_sim.serve, config)
        self.edge = running("edge", partial(edge.serve, **options), config)

    def end(self) -> None:
        for service in (self.edge, self.robot):
            service.end()
            service.worker.bus.close()
        self._bus.close()

    def _see(self, *_message: object) -> None:
        self.seen_at_router += 1

    def episode(self, number: int) -> Episode:
        """The next one that is delivered of that number."""
        self.learner.episode = number
        while (episode := self.learner.next_delivery()).meta.episode != number:
            pass
        return episode


@pytest.fixture
def loop(open_bus: Callable[[], Bus], running: Callable[..., Running]) -> Callable[..., Loop]:
    return partial(Loop, open_bus, running)


def same(episode: Episode, other: Episode) -> None:
    for name in ("frames", "actions", "outputs"):
        np.testing.assert_array_equal(getattr(episode, name), getattr(other, name))


@pytest.fixture
def undisturbed(loop: Callable[..., Loop]) -> list[Episode]:
    """Episodes by the router alone."""
    by_router = loop(LOCKSTEP, past_router=False)
    episodes = [by_router.episode(number) for number in range(3)]
    assert by_router.seen_at_router >= 3 * FRAMES
    by_router.end()
    return episodes


def test_the_router_sees_hardly_a_frame_and_the_episodes_are_the_same(
    loop: Callable[..., Loop], undisturbed: list[Episode]
) -> None:
    shorter = loop(LOCKSTEP)
    for number, expected in enumerate(undisturbed):
        same(shorter.episode(number), expected)
    before = shorter.seen_at_router
    for number, expected in enumerate(undisturbed):
        same(shorter.episode(number), expected)
    # a resent frame of a busy machine goes both ways
    assert shorter.seen_at_router - before < FRAMES


def test_a_way_that_breaks_again_and_again_costs_no_episode(
    loop: Callable[..., Loop], undisturbed: list[Episode], monkeypatch: pytest.MonkeyPatch
) -> None:
    sent, broken = itertools.count(), []
    whole = LocalConnection.put

    def put(self: LocalConnection, attachment: bytes, payload: bytes) -> bool:
        if next(sent) % 7 == 6:
            broken.append(self)
            self.close()
        return whole(self, attachment, payload)

    monkeypatch.setattr(LocalConnection, "put", put)
    disturbed = loop(LOCKSTEP)
    for number, expected in enumerate(undisturbed):
        same(disturbed.episode(number), expected)
    assert broken
    assert "frames_refused" not in disturbed.edge.counters
    assert disturbed.learner.faults == []


@pytest.mark.parametrize("config", [LOCKSTEP, REALTIME])
def test_a_way_that_swallows_everything_is_given_up_soon(
    loop: Callable[..., Loop], config: RunConfig, monkeypatch: pytest.MonkeyPatch
) -> None:
    sent = itertools.count()
    whole = LocalConnection.put

    def put(self: LocalConnection, attachment: bytes, payload: bytes) -> bool:
        return next(sent) >= 12 or whole(self, attachment, payload)

    monkeypatch.setattr(LocalConnection, "put", put)
    swallowed = loop(config)
    for number in range(3):
        swallowed.episode(number)
    assert next(sent) > 12
    assert swallowed.seen_at_router > FRAMES
    assert swallowed.learner.faults == []
    # the frame that was swallowed is sent again, and every later one goes both ways
    assert swallowed.robot.counters.get("frames_sent_again", 0) <= 3
