"""With real processes: what is restarted, what is not, and that nothing is left."""

import os
import signal
from collections.abc import Callable
from pathlib import Path

import pytest

from bpn.supervisor import Service, Supervisor

ROUTER = ["bpn_shared.bus.router", "--listen"]


def test_a_wrong_option_is_not_tried_again_and_the_failure_names_the_log(
    tmp_path: Path, wait_for: Callable[..., None]
) -> None:
    supervisor = Supervisor([Service("router", ["bpn_shared.bus.router", "--colour"])], tmp_path)
    supervisor.start()

    def failed() -> bool:
        supervisor.check()
        return bool(supervisor.failure)

    wait_for(failed, "the failure")
    assert supervisor.failure.startswith(
        "router: bpn-router: error: unrecognized arguments: --colo"
    )
    assert supervisor.failure.endswith(f"(see {tmp_path / 'router.log'})")
    assert supervisor.services[0].restarts == 0
    assert supervisor.failed is not None
    assert supervisor.failed.wrong_input


def test_the_same_reason_again_and_again_ends_it_and_is_told(
    tmp_path: Path, wait_for: Callable[..., None]
) -> None:
    supervisor = Supervisor([Service("nothing", ["bpn_no_such_module"])], tmp_path)
    supervisor.start()

    def failed() -> bool:
        supervisor.check()
        return bool(supervisor.failure)

    wait_for(failed, "the failure")
    assert supervisor.failure.startswith("nothing: ")
    assert "No module named bpn_no_such_module" in supervisor.failure
    assert supervisor.services[0].deaths == 3


@pytest.mark.parametrize("essential", [True, False])
def test_a_worker_that_cannot_start_is_said_and_the_others_go_on(
    essential: bool, tmp_path: Path, wait_for: Callable[..., None], caplog: pytest.LogCaptureFixture
) -> None:
    service = Service("router", ["bpn_shared.bus.router", "--colour"], essential=essential)
    supervisor = Supervisor([service], tmp_path)
    supervisor.start()

    def failed() -> bool:
        supervisor.check()
        return bool(service.failure)

    wait_for(failed, "the failure")
    assert bool(supervisor.failure) == essential
    assert ("--colour" in caplog.text) != essential  # once: here, or by whoever ends with it


def test_what_crashes_at_once_is_restarted_later_and_later(
    tmp_path: Path, wait_for: Callable[..., None], monkeypatch: pytest.MonkeyPatch
) -> None:
    # another reason each time: its process
    program = "import os, sys; sys.exit(f'process {os.getpid()}')"
    (tmp_path / "dies.py").write_text(program)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    service = Service("nothing", ["dies"])
    supervisor = Supervisor([service], tmp_path)
    supervisor.start()
    delays: dict[int, float] = {}

    def died_three_times() -> bool:
        supervisor.check()
        if service.process is None:
            delays.setdefault(service.deaths, service.restart_at_s - service.started_s)
        return service.deaths >= 3

    wait_for(died_three_times, "three deaths")
    supervisor.stop()
    assert service.restarts >= 2
    assert delays[1] >= 0.2
    assert delays[2] >= 0.4
    assert delays[3] >= 0.8


def test_a_killed_service_comes_back_and_stop_leaves_none(
    tmp_path: Path, free_tcp_endpoint: str, wait_for: Callable[..., None]
) -> None:
    service = Service("router", [*ROUTER, free_tcp_endpoint])
    supervisor = Supervisor([service], tmp_path)
    supervisor.start()
    first = service.pid
    assert first is not None
    os.kill(first, signal.SIGKILL)

    def came_back() -> bool:
        supervisor.check()
        return service.pid not in (None, first)

    wait_for(came_back, "the second router")
    second = service.process
    assert second is not None
    supervisor.stop()
    assert second.poll() is not None
    assert not supervisor.failure


def test_a_run_that_was_removed_stays_removed(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        Supervisor([], tmp_path / "removed" / "logs").start()
    assert not list(tmp_path.iterdir())
