"""An action may come after minutes, from an edge that was frozen: the frame that tells of it can be sent."""

import pytest

from bpn_robot.service import Answer
from bpn_shared.messages.base import LONGEST_NS
from bpn_shared.messages.frame import FrameHeader, FrameKind


@pytest.mark.parametrize("late_ns", [1, LONGEST_NS, LONGEST_NS + 1, 3600 * 10**9])
def test_how_late_an_action_was_fits_into_the_next_frames_header(late_ns: int) -> None:
    answer = Answer(action=3, t_capture_ns=7, t_act_ns=7 + late_ns)
    header = FrameHeader(FrameKind.MID, 0, 0, 1, 1, 1, 3, answer.camera_to_action_ns, 0)
    assert FrameHeader.decode(header.encode()).camera_to_action_ns == min(late_ns, LONGEST_NS)
