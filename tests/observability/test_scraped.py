"""A real Prometheus scrapes a real dashboard with workers, and real trouble makes the alerts fire."""

import contextlib
import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import httpx
import pytest
import yaml
from secure_router import SecureRouter

from bpn.dashboard import Dashboard
from bpn_certificates.authority import Validity
from bpn_certificates.folders import make
from bpn_shared.bus import keys
from bpn_shared.bus.certificates import FOLDER_VARIABLE
from bpn_shared.bus.requests import RefusedError, request

FOLDER = Path(__file__).parents[2] / "deploy" / "prometheus"
DEADLINE_S = 120.0
DAY = timedelta(days=1)
CONFIG = {"task": "reaching", "iterations": 50, "episodes": 4, "epochs": 1, "hidden_units": 8}
EXPECTED = {
    "BpnRunStalled": {"task": "reaching"},
    "BpnRunWithoutLearner": {"state": "lost"},
    "BpnLearnerDied": {"event": "learner_deaths"},
    "BpnQueueWithoutWorkers": {"kind": "edge"},
    "BpnMessagesRefused": {"kind": "learner"},
    "BpnDiskNearlyFull": {"folder": "runs"},
    "BpnCertificateNearEnd": {"kind": "robot_sim"},
}
"""Once the learner is killed, while no edge is there; with a label each."""

WaitFor = Callable[..., None]


def hasty(rules: dict[str, Any]) -> dict[str, Any]:
    """The rules without their patience, and for a disk that counts as nearly full whatever is left."""
    for rule in rules["groups"][0]["rules"]:
        if rule.get("for", "1h") != "1h":
            rule["for"] = "1s"
        if rule["alert"] == "BpnDiskNearlyFull":
            assert rule["expr"].endswith("< 0.1")
            rule["expr"] = rule["expr"].replace("< 0.1", "< 1.1")
    return rules


@contextlib.contextmanager
def running(*command: str, certificates: Path | None = None) -> Iterator["subprocess.Popen[bytes]"]:
    variables = {} if certificates is None else {FOLDER_VARIABLE: str(certificates)}
    process = subprocess.Popen(command, env=os.environ | {"OMP_NUM_THREADS": "1"} | variables)
    try:
        yield process
    finally:
        process.terminate()
        process.wait(30)


@contextlib.contextmanager
def prometheus(folder: Path, target: str, token: Path, port: int) -> Iterator[httpx.Client]:
    """The configuration and rules of deploy/prometheus, for this target and in a hurry."""
    config = yaml.safe_load((FOLDER / "prometheus.yaml").read_text())
    config["global"] = {"scrape_interval": "1s", "evaluation_interval": "1s"}
    (scraped,) = config["scrape_configs"]
    scraped["static_configs"] = [{"targets": [target]}]
    scraped["authorization"]["credentials_file"] = str(token)
    (folder / "prometheus.yaml").write_text(yaml.safe_dump(config))
    (rules,) = config["rule_files"]
    rendered = hasty(yaml.safe_load((FOLDER / rules).read_text()))
    (folder / rules).write_text(yaml.safe_dump(rendered))
    listen = f"127.0.0.1:{port}"
    command = ["prometheus", f"--config.file={folder}/prometheus.yaml", "--log.level=warn"]
    with (
        running(*command, f"--storage.tsdb.path={folder}/data", f"--web.listen-address={listen}"),
        httpx.Client(base_url=f"http://{listen}/api/v1") as client,
    ):
        yield client


def firing(client: httpx.Client) -> list[dict[str, Any]]:
    try:
        alerts = client.get("/alerts").json()["data"]["alerts"]
    except httpx.TransportError:  # it starts
        return []
    return [alert for alert in alerts if alert["state"] == "firing"]


@pytest.mark.timeout(3 * DEADLINE_S)
def test_trouble_that_is_really_there_makes_the_alerts_fire_and_no_others(
    tmp_path: Path, free_tcp_port: Callable[[], int], wait_for: WaitFor
) -> None:
    endpoint = f"tls/localhost:{free_tcp_port()}"
    secured = SecureRouter(endpoint, tmp_path / "certificates")
    make(secured.certificates, days=365, server_names=["localhost"])
    now = datetime.now(UTC)
    secured.reissue("robot_sim", Validity(now - 345 * DAY, now + 20 * DAY))
    runs_dir, token = tmp_path / "runs", tmp_path / "token"

    def service(module: str, role: str, *arguments: str) -> Any:
        command = [sys.executable, "-m", module, *arguments]
        return running(*command, certificates=secured.certificates / role)

    with contextlib.ExitStack() as stack:
        start = stack.enter_context
        router = ["--listen", endpoint, "--certificates", str(secured.certificates / "router")]
        start(service("bpn_shared.bus.router", "router", *router))
        place = ["--connect", endpoint]
        options = ["--runs-dir", str(runs_dir), "--port", "0", "--metrics-token", str(token)]
        start(service("bpn_dashboard", "dashboard", *options, *place))
        learner = start(service("bpn_learner", "learner", "--runs-dir", str(runs_dir), *place))
        start(service("bpn_robot_sim", "robot_sim", *place))
        address = runs_dir / ".dashboard.json"
        wait_for(lambda: Dashboard.find(runs_dir) is not None, "the dashboard", DEADLINE_S)
        dashboard = Dashboard.find(runs_dir)
        assert dashboard is not None
        target = json.loads(address.read_text())["url"].removeprefix("http://")
        seen = start(prometheus(tmp_path, target, token, free_tcp_port()))
        run = dashboard.create_run(CONFIG)["id"]
        wait_for(lambda: dashboard.run(run)["state"] == "running", "the run to begin", DEADLINE_S)

        def names() -> set[str]:
            return {alert["labels"]["alertname"] for alert in firing(seen)}

        def has(kind: str) -> bool:
            query = {"query": f'bpn_worker_info{{kind="{kind}"}}'}
            return bool(seen.get("/query", params=query).json()["data"]["result"])

        wait_for(lambda: has("learner"), "a scrape of the learner", DEADLINE_S)
        with secured.open_as("edge") as bus:
            for _ in range(10):
                with pytest.raises(RefusedError):
                    request(bus, keys.next_episode(run), b"no question", timeout_s=10.0)
        wait_for(lambda: "BpnMessagesRefused" in names(), "refused messages", DEADLINE_S)
        learner.send_signal(signal.SIGKILL)
        wait_for(lambda: names() >= EXPECTED.keys(), f"{EXPECTED.keys()}", DEADLINE_S)

        fired = firing(seen)
        assert {alert["labels"]["alertname"] for alert in fired} == EXPECTED.keys()
        for alert in fired:
            print(f"{alert['labels']['alertname']}: {alert['annotations']['summary']}")
        for name, labels in EXPECTED.items():
            assert any(
                labels.items() <= a["labels"].items()
                for a in fired
                if a["labels"]["alertname"] == name
            )
        texts = {a["labels"]["alertname"]: a["annotations"] for a in fired}
        assert run in texts["BpnRunStalled"]["summary"]
        assert "queue" in texts["BpnRunStalled"]["description"]
        assert "ends in 20.0 days" in texts["BpnCertificateNearEnd"]["summary"]
        days = {
            c["kind"]: c["days_left"]
            for c in dashboard._call("GET", "/system/status")["certificates"]
        }
        assert days == pytest.approx({"robot_sim": 20, "dashboard": 365, "router": 365}, abs=0.1)
