import logging
from collections.abc import Callable
from pathlib import Path
from uuid import UUID

import pytest
from logged import lines

from bpn_shared.bus import keys, logs
from bpn_shared.bus.latest import LatestPublisher
from bpn_shared.bus.logs import LogCollector, LogPublisher
from bpn_shared.bus.session import Bus
from bpn_shared.messages import log_lines
from bpn_shared.runtime.worker import service_names
from bpn_shared.spec.config import RunConfig

RUN = UUID(int=1)
SERVICES = service_names(RunConfig.bare("reaching"))


def test_what_a_leased_worker_logs_reaches_the_run_folder(
    open_bus: Callable[[], Bus], tmp_path: Path, wait_for: Callable[..., None]
) -> None:
    collector = LogCollector(open_bus(), RUN, tmp_path, SERVICES)
    file = tmp_path / "edge-0.log"
    logger = logging.getLogger("somewhere")
    with LogPublisher(open_bus(), RUN, "edge-0"):

        def said() -> bool:
            logger.warning("hello %d", 7)
            return file.exists()

        wait_for(said, "a line")
    logger.warning("after the lease")
    first = log_lines.parse(file.read_text().splitlines()[0])
    assert (first.service, first.level, first.message) == ("edge-0", "WARNING", "hello 7")
    assert "after the lease" not in file.read_text()
    del collector


def test_no_line_becomes_another_file_and_no_file_grows_without_end(
    open_bus: Callable[[], Bus], tmp_path: Path, wait_for: Callable[..., None],
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.setattr(logs, "MAX_RUN_BYTES", 600)  # of three services
    folder = tmp_path / "logs"
    folder.mkdir()
    collector = LogCollector(open_bus(), RUN, folder, SERVICES)
    bus = open_bus()
    publishers = {
        name: LatestPublisher(bus, keys.log(RUN, name), "frame")
        for name in (
            "..",
            "edge-0",
            "Edge-0",
            "state.json",
            "edge-0.log",
            "edge-1",
            "edge-00",
            "edge",
            "robot_sim-9",
            "robot_sim-" + "1" * 250,
        )
    }

    def send() -> bool:
        for publisher in publishers.values():
            publisher.put(b"x" * 60)
        file = folder / "edge-0.log"
        return file.exists() and file.stat().st_size > 100

    wait_for(send, "lines")
    for _ in range(20):
        send()
    assert (folder / "edge-0.log").stat().st_size <= 200
    assert [path.name for path in folder.iterdir()] == ["edge-0.log"]
    assert [path.name for path in tmp_path.iterdir()] == ["logs"]
    del collector


def test_lines_that_cannot_be_written_are_said_to_be_lost_once(
    open_bus: Callable[[], Bus], tmp_path: Path, wait_for: Callable[..., None],
    caplog: pytest.LogCaptureFixture,
) -> None:  # fmt: skip
    folder = tmp_path / "logs"
    folder.symlink_to("/nowhere/logs")
    with LogCollector(open_bus(), RUN, folder, SERVICES) as collector:
        publisher = LatestPublisher(open_bus(), keys.log(RUN, "edge-0"), "frame")

        def lost(count: int) -> bool:
            publisher.put(b"line")
            return collector.lost >= count

        wait_for(lambda: lost(5), "lines to be lost")
        said = lines(caplog, LogCollector)
        assert said == ["log lines of workers are lost: " + said[0].partition(": ")[2]]
        assert "No such file or directory" in said[0]
        folder.unlink()
        folder.mkdir()

        def kept() -> bool:
            publisher.put(b"line")
            return (folder / "edge-0.log").exists()

        wait_for(kept, "lines to be kept")
        wait_for(lambda: collector.lost == 0, "the count to be told")
        assert "kept again" in lines(caplog, LogCollector)[-1]
