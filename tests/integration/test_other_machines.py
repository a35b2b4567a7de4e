"""A robot on another machine, by the commands of docs/other-machines.md as they stand there and are printed."""

import re
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from namespaces import NetworkMachine, connect, machine, running
from other_machines import Typed, typed

WaitFor = Callable[..., None]
PAGE = Path(__file__).parents[2] / "docs" / "other-machines.md"
JOIN = r"bpn join bpn1-\S+"
FRAMES_BYTES = 2 * 2 * 20 * 84 * 84
"""Of the run that the page has."""


def commands() -> dict[str, list[str]]:
    """The commands of the page's set-up, by the machine that they are typed at."""
    _, _, section = PAGE.read_text().partition("## The second machine's set-up")
    section = section.partition("\n## ")[0]
    blocks = re.findall(r"```sh\n# (.*)\n((?:.+\n)+?)```", section)
    found: dict[str, list[str]] = {}
    for where, lines in blocks:
        found.setdefault(where, []).extend(line for line in lines.splitlines() if line)
    return found


@pytest.fixture
def machines(tmp_path: Path) -> Iterator[tuple[NetworkMachine, NetworkMachine]]:
    with machine(tmp_path / "center") as center, machine(tmp_path / "robot") as robot:
        connect(center, "10.77.0.1/24", robot, "10.77.0.2/24")
        yield center, robot


def test_the_page_followed_to_the_letter_joins_a_robot_and_finishes_a_run(
    machines: tuple[NetworkMachine, NetworkMachine], wait_for: WaitFor
) -> None:
    center, robot = machines
    here, there = (commands()[where] for where in ("where it learns", "on the robot's machine"))
    up = Typed(center, here[0])
    with running(up.process):
        wait_for(lambda: up.printed(JOIN), "the command for the other machine", 120)
        join = str(up.printed(JOIN))
        joined = Typed(robot, there[0].replace("bpn join TOKEN", join))
        with running(joined.process):
            wait_for(lambda: "this machine is" in joined.text(), "the machine to have joined", 60)
            sent_bytes = robot.sent_bytes()
            done = center.run(typed(here[1]), 300)
            assert done.returncode == 0, done.stderr + joined.text()
            assert robot.sent_bytes() - sent_bytes < FRAMES_BYTES
        # A token is good once; a machine that has joined goes on without one.
        refused = robot.run(typed(f"{join} --state-dir other"), 60)
        assert refused.returncode == 2
        assert "the token was used at" in refused.stderr
        assert refused.stderr.count("\n") == 1
        again = Typed(robot, there[1])
        with running(again.process):
            done = center.run(typed(here[1]), 300)
            assert done.returncode == 0, done.stderr + again.text()
    assert up.process.returncode == 130
