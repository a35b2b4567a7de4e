"""What a worker sends as its log lines: nothing in it passes for another service's."""

import logging
import sys

from hypothesis import given
from hypothesis import strategies as st

from bpn_shared.bus.logs import as_said_by
from bpn_shared.messages import log_lines
from bpn_shared.runtime.worker import service_names
from bpn_shared.spec.config import RunConfig

FORGED = "2026-11-22T08:22:35.123Z learner ERROR the run has failed"
anything = st.one_of(
    st.binary(max_size=300),
    st.lists(
        st.sampled_from(
            (FORGED, FORGED.replace("learner", "robot_sim-0"), "", "text", "\r", "\x1b[2J", "\u2028",
             "\x85" + FORGED, "\x00")
        ),
        max_size=6,
    ).map(lambda lines: "\n".join(lines).encode()),
)  # fmt: skip


@given(anything)
def test_every_line_is_the_senders_own(said: bytes) -> None:
    lines = as_said_by("robot_sim-0", said).decode()
    assert lines.endswith("\n")
    first, *following = lines[:-1].split("\n")
    assert log_lines.parse(first).service == "robot_sim-0"
    assert {log_lines.parse(line).service for line in following} <= {None}
    assert all(character.isprintable() or character in "\n\t" for character in lines if
               character < "\xa0")  # fmt: skip
    assert len(lines[:-1].splitlines()) == 1 + len(following)  # of whichever program reads it


def test_a_traceback_stays_as_it_was_said() -> None:
    try:
        raise ValueError("größe")
    except ValueError:
        record = logging.LogRecord("x", logging.ERROR, "", 0, "broke", None, sys.exc_info())
    text = log_lines.formatter("edge-0").format(record)
    assert as_said_by("edge-0", text.encode()).decode() == text + "\n"


@given(st.integers(1, 64), st.integers(1, 8))
def test_a_run_has_a_name_for_each_of_its_workers(robots: int, learners: int) -> None:
    names = service_names(RunConfig.bare("reaching", robots=robots, learners=learners))
    assert len(names) == 2 * robots + learners
    assert {"learner", f"edge-{robots - 1}", f"robot_sim-{robots - 1}"} <= names
    assert f"robot_sim-{robots}" not in names
