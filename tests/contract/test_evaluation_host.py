"""Which trials the host of an evaluation gives to whom."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from learner_side import RUN

from bpn.evaluation.host import EVALUATION, TrialHost
from bpn_shared.bnn.blob import WeightBlob
from bpn_shared.bus import keys
from bpn_shared.bus.requests import request
from bpn_shared.bus.session import Bus
from bpn_shared.messages.control import Assignment, NextEpisode
from bpn_shared.spec.config import RunConfig

CONFIG = RunConfig.for_task("reaching", hidden_units=16, steps=3)


def test_what_an_edge_has_in_hand_goes_to_nobody_until_the_edge_has_lost_it(
    open_bus: Callable[[], Bus],
) -> None:
    blob = replace(WeightBlob.random(CONFIG.network, np.random.default_rng(0)), run=RUN)
    host = TrialHost(open_bus(), RUN, CONFIG, blob, count=4, policy="greedy")
    bus = open_bus()

    def ask(slot: int, in_hand: int | None = None) -> int | None:
        name = None if in_hand is None else (EVALUATION, in_hand)
        asked = NextEpisode(slot=slot, worker=f"edge-{slot}", in_hand=name)
        told = Assignment.decode(request(bus, keys.next_episode(RUN), asked.encode(), timeout_s=10))
        return told.episode if told.status == "play" else None

    assert [ask(0), ask(1)] == [0, 1]
    assert ask(0, in_hand=0) == 2
    assert ask(1, in_hand=1) == 3
    assert ask(0, in_hand=2) == 0  # in hand no more, nor here: it was lost
    assert ask(0, in_hand=0) == 2
    assert ask(1) == 3  # restarted: what it played comes first,
    assert ask(1, in_hand=3) == 1  # then what it had in hand
    assert host.played == 0
