"""Certificates that are good for three minutes: renewed in time nobody notices, otherwise everybody says so."""

import re
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from chaos import RUN_TIMEOUT_S, Progress, facts, longest_s
from compose_project import SERVICES, Project

WaitFor = Callable[..., None]
FILES = "tests/containers/short-certificates.yaml"
LIFE_S = 180.0
RUN = {
    "iterations": 150,
    "episodes": 10,
    "epochs": 1,
    "nodes": 24,
    "replay_iterations": 2,
    "seed": 11,
}
"""Longer than the last half minute of a certificate, on a machine that does nothing else."""
END = """
from pathlib import Path
from bpn_shared.bus.x509 import facts_of
print(facts_of(Path("/certificates/certificate.pem")).end.timestamp())
"""
OBSTACLE = "from bpn_shared.bus.obstacle import obstacle; print(obstacle('tls/router:7447'))"


@pytest.fixture
def project(start: Callable[..., Project]) -> Iterator[Project]:
    started = start(FILES)
    yield started
    started.down()


def python(project: Project, service: str, program: str) -> str:
    return project.compose("exec", "-T", service, "python", "-c", program).strip()


def end_unix_s(project: Project, service: str) -> float:
    return float(python(project, service, END))


def lines(project: Project, service: str, level: str, what: str) -> list[str]:
    said = project.compose("logs", "--no-log-prefix", service).splitlines()
    return [line for line in said if f" {level} " in line and re.search(what, line)]


def renew(project: Project) -> str:
    return project.compose("run", "--rm", "certificates", timeout_s=120)


def is_over(project: Project, run: str) -> bool:
    return bool(project.api("GET", f"/runs/{run}")["state"] == "finished")


def test_renewed_in_time_they_are_used_and_no_episode_is_lost(
    project: Project, wait_for: WaitFor
) -> None:
    first_end_unix_s = end_unix_s(project, "router")
    wait_for(lambda: time.time() > first_end_unix_s - 30, "the last half minute", LIFE_S)
    run = project.start_run(**RUN)
    wait_for(lambda: "router" in renew(project), "certificates to be renewed", 60.0)
    wait_for(lambda: time.time() > first_end_unix_s + 5, "the first ones to end", LIFE_S)
    assert project.api("GET", f"/runs/{run}")["state"] == "running"
    assert python(project, "edge", OBSTACLE) == ""  # who comes now is let in
    wait_for(lambda: renew(project) and is_over(project, run), "the run to end", RUN_TIMEOUT_S)
    pause_s = longest_s(Progress(project, run, "router").stored_unix_s())
    print(f"PAUSE certificates renewed: {pause_s:.1f} s at the most")
    found = facts(project, run)
    assert (found["lost"], found["duplicated"]) == (0, 0)
    assert lines(project, "router", "INFO", "there are new certificates")
    assert {s: lines(project, s, "ERROR", "") for s in SERVICES} == {s: [] for s in SERVICES}


def test_not_renewed_everybody_says_why_before_and_after_and_goes_on_when_they_are(
    project: Project, wait_for: WaitFor
) -> None:
    token = project.token()
    last_unix_s = end_unix_s(project, "router")

    def days_left() -> dict[str, float]:
        """By kind of service, as /metrics has it."""
        found = re.findall(
            r'^bpn_certificate_days_left\{kind="(\w+)".*\} (\S+)$',
            project.metrics(token), re.MULTILINE,
        )  # fmt: skip
        return {kind: float(days) for kind, days in found}

    def shown() -> dict[str, Any]:
        """By kind of service, as the System page has it."""
        status = project.api("GET", "/system/status", token=token)
        return {each["kind"]: each for each in status["certificates"]}

    def warned() -> bool:
        return all(
            lines(project, s, "WARNING", r"certificate \S+ ends in .* renew it") for s in SERVICES
        )

    wait_for(warned, "everybody to warn", LIFE_S)
    before = days_left()
    assert before.keys() == set(SERVICES)
    assert {kind for kind, each in shown().items() if each["near_end"]} == set(SERVICES)
    assert time.time() < last_unix_s
    assert min(before.values()) > 0
    assert not any(lines(project, s, "ERROR", "") for s in SERVICES)

    wait_for(lambda: time.time() > last_unix_s - 30, "the last half minute", LIFE_S)
    run = project.start_run(**RUN)

    def told() -> bool:
        return all(
            lines(project, s, "ERROR", r"certificate \S+ expired .* renew it") for s in SERVICES
        )

    wait_for(told, "everybody to say that they have ended", LIFE_S)
    after = days_left()
    assert {"dashboard", "router"} <= after.keys()  # workers are not heard any more
    assert max(after.values()) < 0
    wait_for(
        lambda: "expired" in str(project.api("GET", f"/runs/{run}", token=token)["waiting_reason"]),
        "the run to say why it waits", 90.0,
    )  # fmt: skip
    (router,) = project.containers("router")
    wait_for(lambda: project.state(router)["Health"]["Status"] == "unhealthy", "its health", 90.0)

    assert "router" in renew(project)
    project.wait_well()
    wait_for(lambda: renew(project) and is_over(project, run), "the run to end", RUN_TIMEOUT_S)
    found = facts(project, run)
    assert (found["lost"], found["duplicated"]) == (0, 0)
