"""bpn verify in real time: the frame that an action answered is among those that it looks at."""

from collections import deque
from dataclasses import replace

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from played import TASK, episode

from bpn.verify.recorded import Recording, answered
from bpn_shared.spec.config import RunConfig

STEPS = 12
PERIOD_NS = round(1e9 * TASK.control_period_s)


@given(
    data=st.data(),
    low_ms=st.floats(0, 2000),
    more_ms=st.floats(0, 2000),
    delay_ms=st.floats(0, 500),
)
def test_the_answered_frame_is_found_under_any_latency(
    data: st.DataObject, low_ms: float, more_ms: float, delay_ms: float
) -> None:
    """Actions act in their order, one a period, each after its own latency or when those before it have acted."""
    high_ms = min(2000.0, low_ms + more_ms)
    config = RunConfig.for_task(
        "reaching",
        pacing="realtime",
        action_delay_ms=delay_ms,
        disturb=f"latency={low_ms}..{high_ms}",
    )
    in_flight: deque[tuple[int, int]] = deque()
    acted, loops_ns = [], np.zeros(STEPS, np.int64)
    for step in range(STEPS):
        end_ns = (step + 1) * PERIOD_NS
        latency_ms = delay_ms + data.draw(st.floats(low_ms, high_ms))
        edge_ns = data.draw(st.integers(1, PERIOD_NS - 1))
        in_flight.append((step, step * PERIOD_NS + edge_ns + round(1e6 * latency_ms)))
        acted.append(None)
        if in_flight[0][1] < end_ns:
            acted[step], t_act_ns = in_flight.popleft()
            loops_ns[step] = t_act_ns - acted[step] * PERIOD_NS
    stored = replace(episode(0, 0, steps=STEPS), camera_to_action_ns=loops_ns)
    recording = Recording(config, None, 0, 0, stored)  # type: ignore[arg-type]
    for step, frame in enumerate(acted):
        found = answered(recording, step)
        assert found == [] if frame is None else frame in found
