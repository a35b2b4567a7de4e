"""The alert rules, by Prometheus's own checker: each fires when it should, and at no other time."""

import subprocess
from pathlib import Path
from typing import NamedTuple

import pytest
import yaml

FOLDER = Path(__file__).parents[2] / "deploy" / "prometheus"
RULES = yaml.safe_load((FOLDER / "alerts.yaml").read_text())["groups"][0]["rules"]
DISK = {"bpn_disk_size_bytes": "100e9x20"}
DEATHS = 'bpn_dashboard_events_total{event="learner_deaths"}'
LEFT, LIFE = 'bpn_certificate_days_left{kind="edge"}', 'bpn_certificate_life_days{kind="edge"}'
VACANT, EDGES = (
    'bpn_places_vacant{kind="edge"}',
    'bpn_workers{kind="edge",state="idle"}',
)


class Case(NamedTuple):
    """What is scraped each minute, in promtool's notation, and whether the alert fires after some time."""

    alert: str
    series: dict[str, str]
    fires: bool
    after: str = "10m"


CASES = [
    Case("BpnDashboardDown", {'up{job="bpn"}': "1 0x20"}, True),
    Case("BpnDashboardDown", {'up{job="bpn"}': "1 0x20"}, False, "1m"),
    Case("BpnDashboardDown", {'up{job="bpn"}': "1 0 1x20"}, False),
    Case("BpnDashboardDown", {'up{job="other"}': "0x20"}, False),
    Case("BpnRegistryNotServing", {'bpn_registry_serving{job="bpn"}': "0x20"}, True),
    Case("BpnRegistryNotServing", {'bpn_registry_serving{job="bpn"}': "0 1x20"}, False),
    Case(
        "BpnRegistryNotServing",  # the one that waits to take over does not serve
        {f'bpn_registry_serving{{job="bpn",instance="{i}"}}': f"{i}x20" for i in (0, 1)},
        False,
    ),
    Case("BpnRunStalled", {'bpn_run_stalled{run="r"}': "0 1x20"}, True),
    Case("BpnRunStalled", {'bpn_run_stalled{run="r"}': "0 1x20"}, False, "1m"),
    Case("BpnRunStalled", {'bpn_run_stalled{run="r"}': "0x20"}, False),
    Case("BpnRunWithoutLearner", {'bpn_run_state{state="lost"}': "1x20"}, True),
    Case("BpnRunWithoutLearner", {'bpn_run_state{state="running"}': "1x20"}, False),
    Case("BpnLearnerDied", {DEATHS: "0 0 1x20"}, True, "5m"),
    Case("BpnLearnerDied", {DEATHS: "0 0 1x60"}, False, "30m"),
    Case("BpnLearnerDied", {'bpn_dashboard_events_total{event="live_clients"}': "0+1x20"}, False),
    Case("BpnRunFailed", {'bpn_runs{state="failed"}': "3x20 4x60"}, True, "25m"),
    Case("BpnRunFailed", {'bpn_runs{state="failed"}': "3x20 4x60"}, False, "60m"),
    Case("BpnRunFailed", {'bpn_runs{state="failed"}': "3x20 2x60"}, False, "25m"),
    Case("BpnQueueWithoutWorkers", {VACANT: "2x20", EDGES: "0x20"}, True),
    Case("BpnQueueWithoutWorkers", {VACANT: "2x20", EDGES: "1x20"}, False),
    Case("BpnQueueWithoutWorkers", {VACANT: "0x20", EDGES: "0x20"}, False),
    Case("BpnWorkersRefused", {"bpn_workers_refused": "1x20"}, True),
    Case("BpnWorkersRefused", {"bpn_workers_refused": "1 0x20"}, False),
    Case("BpnMessagesRefused", {'bpn_refusals_total{kind="learner"}': "0+2x20"}, True),
    Case("BpnMessagesRefused", {'bpn_refusals_total{kind="learner"}': "0 0 1x20"}, False),
    Case("BpnMessagesRefused", {'bpn_refusals_total{kind="learner"}': "900x20"}, False),
    Case("BpnDiskNearlyFull", {"bpn_disk_free_bytes": "9e9x20", **DISK}, True),
    Case("BpnDiskNearlyFull", {"bpn_disk_free_bytes": "11e9x20", **DISK}, False),
    Case("BpnDiskFullTomorrow", {"bpn_disk_free_bytes": "50e9-100e6x400"}, True, "300m"),
    Case("BpnDiskFullTomorrow", {"bpn_disk_free_bytes": "50e9-10e6x400"}, False, "300m"),
    Case("BpnDiskFull", {"bpn_disk_free_bytes": "200e6x20"}, True),
    Case("BpnDiskFull", {"bpn_disk_free_bytes": "300e6x20"}, False),
    Case("BpnCertificateNearEnd", {LEFT: "29.9x20", LIFE: "365x20"}, True, "0m"),
    Case("BpnCertificateNearEnd", {LEFT: "30x20", LIFE: "365x20"}, False),
    Case("BpnCertificateNearEnd", {LEFT: "3x20", LIFE: "7x20"}, False),
    Case("BpnCertificateNearEnd", {LEFT: "1.7x20", LIFE: "7x20"}, True),
    Case("BpnCertificateExpired", {LEFT: "-0.1x20"}, True, "0m"),
    Case("BpnCertificateExpired", {LEFT: "0.1x20"}, False),
    Case("BpnRunFoldersUnreadable", {"bpn_run_folders_unreadable": "1x20"}, True),
    Case("BpnRunFoldersUnreadable", {"bpn_run_folders_unreadable": "0x20"}, False),
]


def promtool(*arguments: object) -> None:
    done = subprocess.run(
        ["promtool", *map(str, arguments)], capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr


def test_prometheus_accepts_the_rules_and_the_configuration(tmp_path: Path) -> None:
    promtool("check", "rules", FOLDER / "alerts.yaml")
    token = tmp_path / "token"
    token.write_text("x")
    config = (FOLDER / "prometheus.yaml").read_text().replace("/metrics/token", str(token))
    (tmp_path / "prometheus.yaml").write_text(config)
    (tmp_path / "alerts.yaml").symlink_to(FOLDER / "alerts.yaml")
    promtool("check", "config", tmp_path / "prometheus.yaml")


def test_every_alert_has_a_case_in_which_it_fires_and_one_in_which_it_stays_silent() -> None:
    for fires in (True, False):
        assert {c.alert for c in CASES if c.fires is fires} == {rule["alert"] for rule in RULES}


def test_every_alert_fires_when_it_should_and_at_no_other_time(tmp_path: Path) -> None:
    tests = {
        "rule_files": [str(FOLDER / "alerts.yaml")],
        "evaluation_interval": "15s",
        "tests": [_test(number, case) for number, case in enumerate(CASES)],
    }
    file = tmp_path / "cases.yaml"
    file.write_text(yaml.safe_dump(tests))
    promtool("test", "rules", file)


def test_the_checker_sees_a_case_that_is_wrong(tmp_path: Path) -> None:
    file = tmp_path / "cases.yaml"
    wrong = _test(0, CASES[0]._replace(fires=False))
    rules = [str(FOLDER / "alerts.yaml")]
    file.write_text(yaml.safe_dump({"rule_files": rules, "tests": [wrong]}))
    with pytest.raises(AssertionError, match="BpnDashboardDown"):
        promtool("test", "rules", file)


def _test(number: int, case: Case) -> dict[str, object]:
    expression = f'count(ALERTS{{alertname="{case.alert}",alertstate="firing"}})'
    return {
        "name": f"{number}: {case.alert} {'fires' if case.fires else 'is silent'}",
        "interval": "1m",
        "input_series": [{"series": name, "values": v} for name, v in case.series.items()],
        "promql_expr_test": [
            {
                "expr": expression,
                "eval_time": case.after,
                "exp_samples": [{"labels": "{}", "value": 1}] if case.fires else [],
            }
        ],
    }
