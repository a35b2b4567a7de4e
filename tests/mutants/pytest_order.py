"""pytest plugin: notes what every test runs of a file and how long it takes, and runs tests in a given order.

Not the order of files is changed alone: a fixture of a file is made once, since files are never mixed.
"""

import json
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from types import FrameType

import pytest
from hypothesis import Phase, settings

_TIMED = "contract"
"""Tests in which services wait for each other: being watched is too slow for them."""


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--note", nargs=2, metavar=("FILE", "JSON"), help="what tests run of FILE")
    parser.addoption("--order", metavar="JSON", help="ids of tests, in the order to run them in")


def pytest_sessionstart(session: pytest.Session) -> None:
    # that an example fails is enough: none is made smaller
    settings.register_profile("mutants", settings(), phases=(Phase.explicit, Phase.generate))
    settings.load_profile("mutants")
    if session.config.getoption("note"):
        session.config.pluginmanager.register(_Notes(*session.config.getoption("note")))


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    if config.getoption("order"):
        ids = json.loads(Path(config.getoption("order")).read_text())
        place = {nodeid: number for number, nodeid in enumerate(ids)}
        items.sort(key=lambda item: place.get(item.nodeid, len(place)))


class _Notes:
    """By test: its seconds, and the functions of the file that ran in it (in this process)."""

    def __init__(self, file: str, into: str) -> None:
        self._file, self._into = str(Path(file).resolve()), Path(into)
        self._ran: set[str] = set()
        self._notes: dict[str, dict[str, object]] = {}

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        began_s, self._ran = time.monotonic(), set()
        if item.path.parent.name != _TIMED:
            threading.settrace(self._trace)
            sys.settrace(self._trace)
        try:
            return (yield)
        finally:
            sys.settrace(None)
            threading.settrace(None)  # type: ignore[arg-type]  # which is how it ends
            self._notes[item.nodeid] = {
                "seconds": time.monotonic() - began_s, "functions": sorted(self._ran)
            }  # fmt: skip

    def _trace(self, frame: FrameType, _event: str, _argument: object) -> None:
        """Called as a function begins; its lines are not of interest."""
        if frame.f_code.co_filename == self._file:
            self._ran.add(frame.f_code.co_qualname.replace(".<locals>", ""))

    def pytest_sessionfinish(self) -> None:
        self._into.write_text(json.dumps(self._notes))
