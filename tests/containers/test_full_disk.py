"""The runs' volume is full for a while."""

import os
import time
from collections.abc import Callable

import pytest
from chaos import LONG, RUN_TIMEOUT_S, Progress, facts, reported_return
from compose_project import Project, docker

pytestmark = pytest.mark.skipif("BPN_CHAOS" not in os.environ, reason="run `make test-chaos`")


def test_a_run_goes_on_when_there_is_room_again(start: Callable[..., Project]) -> None:
    project = start("tests/containers/small-disk.yaml")
    undisturbed = project.start_run(**LONG)
    project.wait_finished(undisturbed, RUN_TIMEOUT_S)
    run = project.start_run(**LONG)
    progress = Progress(project, run, "learner")
    progress.wait_beyond(50, RUN_TIMEOUT_S)
    (dashboard,) = project.containers("dashboard")
    docker("exec", dashboard, "sh", "-c", "cat /dev/zero > /runs/ballast 2>/dev/null || true")
    time.sleep(5)  # the fault itself
    with reported_return("disk full for 5 s", progress):
        docker("exec", dashboard, "rm", "/runs/ballast")
    project.wait_finished(run, RUN_TIMEOUT_S)
    assert facts(project, run) == facts(project, undisturbed)
