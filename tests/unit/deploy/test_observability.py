"""Prometheus in compose and Kubernetes: one configuration, and every path in it is there."""

import copy
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import kubernetes_validate
import pytest
import yaml

ROOT = Path(__file__).parents[3]
FOLDER = ROOT / "deploy" / "prometheus"
CONFIG = yaml.safe_load((FOLDER / "prometheus.yaml").read_text())
(SCRAPED,) = CONFIG["scrape_configs"]
TOKEN = SCRAPED["authorization"]["credentials_file"]


def load(name: str) -> Any:
    return yaml.safe_load((FOLDER / name).read_text())


def patched(manifest: dict[str, Any], operations: list[dict[str, Any]]) -> dict[str, Any]:
    """The manifest after additions as RFC 6902 has them, which kustomize makes."""
    manifest = copy.deepcopy(manifest)
    for operation in operations:
        assert operation["op"] == "add"
        *path, last = operation["path"].strip("/").split("/")
        target: Any = manifest
        for step in path:
            target = target[int(step) if isinstance(target, list) else step]
        if isinstance(target, list):
            assert last == "-"
            target.append(operation["value"])
        else:
            assert last not in target
            target[last] = operation["value"]
    return manifest


@pytest.fixture(scope="module")
def deployment() -> dict[str, Any]:
    manifests = yaml.safe_load_all((ROOT / "deploy/kubernetes/dashboard.yaml").read_text())
    (dashboard,) = (m for m in manifests if m["kind"] == "Deployment")
    return patched(dashboard, load("sidecar.yaml"))


def mounts(container: dict[str, Any]) -> dict[str, str]:
    return {mount["mountPath"]: mount["name"] for mount in container["volumeMounts"]}


@pytest.mark.parametrize("version", ["1.30", "1.37"])
def test_the_schema_accepts_the_dashboard_with_prometheus(
    deployment: dict[str, Any], version: str
) -> None:
    kubernetes_validate.validate(deployment, version, strict=True)
    kubernetes_validate.validate(load("claim.yaml"), version, strict=True)


def test_in_kubernetes_prometheus_finds_rules_token_and_dashboard(
    deployment: dict[str, Any],
) -> None:
    kustomization = load("kustomization.yaml")
    assert kustomization["configMapGenerator"] == [
        {"name": "prometheus", "files": ["prometheus.yaml", *CONFIG["rule_files"]]}
    ]
    assert all((FOLDER / resource).exists() for resource in kustomization["resources"])
    pod = deployment["spec"]["template"]["spec"]
    dashboard, prometheus = pod["containers"]
    token = f"--metrics-token={TOKEN}"
    assert token in dashboard["args"]
    folder = str(Path(TOKEN).parent)
    assert mounts(dashboard)[folder] == mounts(prometheus)[folder]
    assert mounts(prometheus)["/etc/prometheus"] == "prometheus-config"
    names = {volume["name"] for volume in pod["volumes"]}
    assert set(mounts(dashboard).values()) | set(mounts(prometheus).values()) == names
    ((target,),) = (each["targets"] for each in SCRAPED["static_configs"])
    host, port = target.split(":")
    assert pod["hostAliases"] == [{"ip": "127.0.0.1", "hostnames": [host]}]
    assert f"--allow-host={host}" in dashboard["args"]
    assert dashboard["ports"][0]["containerPort"] == int(port)
    security = prometheus["securityContext"]
    assert security == dashboard["securityContext"]


def test_in_compose_prometheus_finds_rules_token_and_dashboard() -> None:
    services = yaml.safe_load((ROOT / "compose.yaml").read_text())["services"]
    dashboard, prometheus = services["dashboard"], services["prometheus"]
    assert prometheus["profiles"] == ["observability"]
    assert f"--metrics-token={TOKEN}" in dashboard["command"]
    shared = f"metrics-token:{Path(TOKEN).parent}"
    assert shared in dashboard["volumes"]
    assert f"{shared}:ro" in prometheus["volumes"]
    assert "./deploy/prometheus:/etc/prometheus:ro" in prometheus["volumes"]
    assert "--config.file=/etc/prometheus/prometheus.yaml" in prometheus["command"]
    assert "--allow-host=dashboard" in dashboard["command"]
    kustomized = load("kustomization.yaml")["images"][0]
    assert prometheus["image"] == f"{kustomized['newName']}:{kustomized['newTag']}"


@pytest.mark.skipif(shutil.which("kubectl") is None, reason="kubectl renders, and is not here")
def test_kustomize_takes_it_as_a_component(tmp_path: Path) -> None:
    shutil.copytree(FOLDER, tmp_path / "prometheus")
    (tmp_path / "kubernetes").mkdir()
    manifests = (ROOT / "deploy/kubernetes/dashboard.yaml").read_text()
    (tmp_path / "kubernetes/dashboard.yaml").write_text(manifests)
    whole = {"resources": ["dashboard.yaml"], "components": ["../prometheus"]}
    (tmp_path / "kubernetes/kustomization.yaml").write_text(yaml.safe_dump(whole))
    done = subprocess.run(
        ["kubectl", "kustomize", str(tmp_path / "kubernetes")],
        capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    rendered = list(yaml.safe_load_all(done.stdout))
    for manifest in rendered:
        kubernetes_validate.validate(manifest, "1.37", strict=True)
    (rules,) = (m for m in rendered if m["kind"] == "ConfigMap")
    assert yaml.safe_load(rules["data"]["alerts.yaml"]) == load("alerts.yaml")
    (pod,) = (m["spec"]["template"]["spec"] for m in rendered if m["kind"] == "Deployment")
    assert rules["metadata"]["name"] in str(pod["volumes"])
    assert pod["containers"][1]["image"].startswith("prom/prometheus:v")


def test_every_alert_says_how_grave_it_is_and_where_it_stands_what_to_do() -> None:
    page = (ROOT / "docs/observability.md").read_text()
    (group,) = load("alerts.yaml")["groups"]
    told = dict(re.findall(r"^### (Bpn\w+)\n(Critical|Warning)\. ", page, flags=re.MULTILINE))
    assert told == {r["alert"]: r["labels"]["severity"].title() for r in group["rules"]}
    for rule in group["rules"]:
        assert rule["annotations"].keys() == {"summary", "description", "runbook"}
        anchor = rule["alert"].lower()
        assert rule["annotations"]["runbook"] == f"docs/observability.md#{anchor}"


def test_every_metric_that_a_rule_watches_is_one_of_ours() -> None:
    page = (ROOT / "docs/observability.md").read_text()
    ours = set(re.findall(r"^\| `(bpn_\w+)` \|", page, flags=re.MULTILINE))
    (group,) = load("alerts.yaml")["groups"]
    used = set(re.findall(r"\bbpn_\w+", " ".join(rule["expr"] for rule in group["rules"])))
    assert used <= ours
