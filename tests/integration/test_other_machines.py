"""A robot on another machine, by the commands of docs/other-machines.md as they stand there and are printed."""

import re
import shlex
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from namespaces import NetworkMachine, connect, machine, running

WaitFor = Callable[..., None]
PAGE = Path(__file__).parents[2] / "docs" / "other-machines.md"
BIN = Path(sys.executable).parent
CENTER, ROBOT = "10.77.0.1", "10.77.0.2"


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
        connect(center, f"{CENTER}/24", robot, f"{ROBOT}/24")
        yield center, robot


def typed(line: str) -> list[str]:
    """What a shell would start."""
    program, *words = shlex.split(line)
    return [str(BIN / program), *words]


class Said:
    """What a command has printed so far."""

    def __init__(self, at: NetworkMachine, line: str) -> None:
        at.home.mkdir(exist_ok=True)
        self.path = at.home / f"said-{abs(hash(line))}"
        self.process = at.popen(typed(line), stdout=self.path.open("w"), stderr=subprocess.STDOUT)

    def text(self) -> str:
        text = self.path.read_text()
        assert self.process.poll() is None, text
        return text


def test_the_page_followed_to_the_letter_joins_a_robot_and_finishes_a_run(
    machines: tuple[NetworkMachine, NetworkMachine], wait_for: WaitFor
) -> None:
    center, robot = machines
    here, there = (commands()[where] for where in ("where it learns", "on the robot's machine"))
    up = Said(center, here[0])
    with running(up.process):
        wait_for(lambda: "bpn join bpn1-" in up.text(), "the command for the other machine", 120)
        printed = re.search(r"bpn join bpn1-\S+", up.text())
        assert printed is not None
        join = there[0].replace("bpn join TOKEN", printed[0])
        joined = Said(robot, join)
        with running(joined.process):
            wait_for(lambda: "this machine is" in joined.text(), "the machine to have joined", 60)
            done = center.run(typed(here[1]), 300)
            assert done.returncode == 0, done.stderr + joined.text()
            frames = 2 * 2 * 20 * 84 * 84  # of that run
            assert robot.sent_bytes() < frames / 3
        # A token is good once; a machine that has joined goes on without one.
        refused = robot.run(typed(f"{printed[0]} --state-dir other"), 60)
        assert refused.returncode == 2
        assert "the token was used at" in refused.stderr
        assert refused.stderr.count("\n") == 1
        again = Said(robot, there[1])
        with running(again.process):
            done = center.run(typed(here[1]), 300)
            assert done.returncode == 0, done.stderr + again.text()
    assert up.process.returncode == 130
