"""Compose with the profile observability: Prometheus scrapes the dashboard, with its token, and has the alerts."""

from collections.abc import Callable, Iterator
from typing import Any

import httpx
import pytest
import yaml
from compose_project import ROOT, Project

FILE = "tests/containers/own-prometheus.yaml"
DEADLINE_S = 60.0
RULES = yaml.safe_load((ROOT / "deploy/prometheus/alerts.yaml").read_text())["groups"][0]["rules"]
SERVICES = {"learner", "edge", "robot_sim"}

Ask = Callable[..., list[dict[str, Any]]]


@pytest.fixture(scope="module")
def prometheus(
    start: Callable[..., Project], free_tcp_port: Callable[[], int]
) -> Iterator[httpx.Client]:
    """The loop in containers with the profile, and a client of its Prometheus."""
    port = free_tcp_port()
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("COMPOSE_PROFILES", "observability")
        patch.setenv("PROMETHEUS_PORT", str(port))
        project = start(FILE)
        with httpx.Client(base_url=f"http://127.0.0.1:{port}/api/v1") as client:
            yield client
        project.down()  # with the profile


@pytest.fixture(scope="module")
def ask(prometheus: httpx.Client) -> Ask:
    """The samples of an expression."""

    def query(expression: str) -> list[dict[str, Any]]:
        answer = prometheus.get("/query", params={"query": expression}).raise_for_status()
        found: list[dict[str, Any]] = answer.json()["data"]["result"]
        return found

    return query


def test_it_scrapes_what_the_dashboard_knows(ask: Ask, wait_for: Callable[..., None]) -> None:
    wait_for(lambda: ask('up{job="bpn"} == 1'), "the first scrape", DEADLINE_S)
    idle = 'bpn_workers{state="idle"} == 1'
    wait_for(lambda: {s["metric"]["kind"] for s in ask(idle)} == SERVICES, "workers", DEADLINE_S)
    certificates = ask("bpn_certificate_days_left > 300")
    kinds = {sample["metric"]["kind"] for sample in certificates}
    assert kinds == SERVICES | {"dashboard", "router"}
    (serving,) = ask("bpn_registry_serving")
    assert serving["value"][1] == "1"


def test_it_has_every_rule_and_nothing_is_wrong(
    ask: Ask, prometheus: httpx.Client, wait_for: Callable[..., None]
) -> None:
    def rules() -> list[dict[str, Any]]:
        (group,) = prometheus.get("/rules").json()["data"]["groups"]
        found: list[dict[str, Any]] = group["rules"]
        return found

    def evaluated() -> bool:
        return all(rule["health"] == "ok" for rule in rules())

    wait_for(evaluated, "the rules to be evaluated", DEADLINE_S)
    assert {rule["name"] for rule in rules()} == {rule["alert"] for rule in RULES}
    assert ask('ALERTS{alertname!~"BpnDisk.*"}') == []  # the disk is the test machine's
