"""A robot of its own package that writes down what it is commanded, at once, where a killed process leaves it."""

import os
import time
from pathlib import Path
from typing import NamedTuple

import bars

from bpn_robot.frame import Frame
from bpn_shared.spec.tasks import TaskSpec

JOURNAL = "BPN_TEST_JOURNAL"
"""Environment variable: the file."""
PERIOD_S = 0.05


class Entry(NamedTuple):
    """A call of the robot's: when (monotonic ns), of which process, which one, and its argument, if it has any."""

    t_ns: int
    pid: int
    call: str
    argument: int


def spec() -> TaskSpec:
    return bars.spec(robot="journal", control_period_s=PERIOD_S, preset={"steps": 20})


class JournalRobot(bars.Bar):
    """A bar that stays in the picture, and writes."""

    terminated = False  # type: ignore[assignment]

    def _note(self, call: str, argument: int = -1) -> None:
        line = f"{time.monotonic_ns()} {os.getpid()} {call} {argument}\n"
        with Path(os.environ[JOURNAL]).open("a") as journal:
            journal.write(line)

    def reset(self, seed: int) -> Frame:
        self._note("reset", seed)
        return super().reset(seed)

    def command(self, action: int) -> None:
        super().command(action)
        self.goal_px = min(max(self.goal_px, 12.0), 70.0)
        self._note("command", action)

    def stop(self) -> None:
        super().stop()
        self._note("stop")


def read(journal: Path) -> list[Entry]:
    """All that was written so far."""
    lines = journal.read_text().splitlines() if journal.exists() else []
    return [
        Entry(int(t), int(pid), call, int(argument))
        for t, pid, call, argument in map(str.split, lines)
    ]
