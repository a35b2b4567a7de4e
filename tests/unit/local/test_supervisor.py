"""With real processes: what is restarted, what is not, and that nothing is left."""

import os
import signal
from collections.abc import Callable
from pathlib import Path

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
    assert supervisor.failure == "router ended with exit status 2; see router.log"
    assert supervisor.services[0].restarts == 0
    assert "--colour" in (tmp_path / "router.log").read_text()


def test_what_crashes_at_once_is_restarted_later_and_later(
    tmp_path: Path, wait_for: Callable[..., None]
) -> None:
    service = Service("nothing", ["bpn_no_such_module"])
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
