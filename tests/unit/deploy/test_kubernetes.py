"""The manifests: valid for several versions of Kubernetes, hardened, and of one piece with the containers."""

import re
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import kubernetes_validate
import pytest
import yaml

from bpn_certificates.folders import make
from bpn_shared.bus.access import ROLES
from bpn_shared.bus.certificates import AUTHORITY, CERTIFICATE, KEY

FOLDER = Path(__file__).parents[3] / "deploy" / "kubernetes"
VERSIONS = ["1.30", "1.33", "1.37"]
Manifest = dict[str, Any]


def manifests() -> Iterator[Manifest]:
    for path in sorted(FOLDER.glob("*.yaml")):
        if path.name != "kustomization.yaml":
            yield from yaml.safe_load_all(path.read_text())


ALL = list(manifests())
DEPLOYMENTS = [m for m in ALL if m["kind"] == "Deployment"]
KUSTOMIZATION: Manifest = yaml.safe_load((FOLDER / "kustomization.yaml").read_text())


def name_of(manifest: Manifest) -> str:
    return f"{manifest['kind']}-{manifest['metadata']['name']}"


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("manifest", ALL, ids=name_of)
def test_the_schema_accepts_it(manifest: Manifest, version: str) -> None:
    kubernetes_validate.validate(manifest, version, strict=True)


def test_the_schema_refuses_what_is_wrong() -> None:
    wrong = yaml.safe_load(yaml.safe_dump(DEPLOYMENTS[0]).replace("readinessProbe", "readyProbe"))
    with pytest.raises(kubernetes_validate.ValidationError):
        kubernetes_validate.validate(wrong, VERSIONS[-1], strict=True)


def test_every_file_is_part_of_it() -> None:
    files = {path.name for path in FOLDER.glob("*.yaml")} - {"kustomization.yaml"}
    assert set(KUSTOMIZATION["resources"]) == files


def test_there_is_a_deployment_for_the_router_and_for_every_role() -> None:
    services = {role.replace("_", "-") for role in ("router", *ROLES)}
    assert {m["metadata"]["name"] for m in DEPLOYMENTS} == services
    assert {image["name"] for image in KUSTOMIZATION["images"]} == {f"bpn-{s}" for s in services}
    secrets = {s["name"]: s["files"] for s in KUSTOMIZATION["secretGenerator"]}
    assert secrets == {
        f"certificates-{role.replace('_', '-')}": [
            f"certificates/{role}/{file}" for file in (AUTHORITY, CERTIFICATE, KEY)
        ]
        for role in ("router", *ROLES)
    }


@pytest.mark.parametrize("deployment", DEPLOYMENTS, ids=name_of)
def test_a_deployment_is_hardened_and_sees_its_own_certificates_alone(deployment: Manifest) -> None:
    name = deployment["metadata"]["name"]
    pod = deployment["spec"]["template"]["spec"]
    assert pod["securityContext"]["runAsNonRoot"]
    assert not pod["automountServiceAccountToken"]
    assert pod["terminationGracePeriodSeconds"] == 10
    (container,) = pod["containers"]
    assert container["image"] == f"bpn-{name}"
    security = container["securityContext"]
    assert security["readOnlyRootFilesystem"]
    assert not security["allowPrivilegeEscalation"]
    assert security["capabilities"] == {"drop": ["ALL"]}
    assert container["resources"]["requests"].keys() == {"cpu", "memory"}
    assert "memory" in container["resources"]["limits"]
    assert {"startupProbe", "readinessProbe", "livenessProbe"} <= container.keys()
    mounted = {v["secret"]["secretName"] for v in pod["volumes"] if "secret" in v}
    assert mounted == {f"certificates-{name}"}
    shares_runs = any("persistentVolumeClaim" in volume for volume in pod["volumes"])
    assert shares_runs == (name in ("learner", "dashboard"))


@pytest.mark.parametrize("deployment", DEPLOYMENTS, ids=name_of)
def test_nobody_is_killed_because_the_router_is_away(deployment: Manifest) -> None:
    (container,) = deployment["spec"]["template"]["spec"]["containers"]
    if deployment["metadata"]["name"] == "dashboard":
        assert container["livenessProbe"]["httpGet"]["path"] == "/healthz"
    else:
        for probe in ("startupProbe", "livenessProbe"):
            assert container[probe]["exec"]["command"] == ["healthy"]
        assert container["readinessProbe"]["exec"]["command"] == ["healthy", "--ready"]


def test_one_router_and_one_dashboard_are_replaced_and_never_doubled() -> None:
    for deployment in DEPLOYMENTS:
        if deployment["metadata"]["name"] in ("router", "dashboard"):
            assert deployment["spec"]["replicas"] == 1
            assert deployment["spec"]["strategy"] == {"type": "Recreate"}


def test_network_policies_name_pods_that_exist_and_let_everyone_reach_the_router() -> None:
    policies = [m for m in ALL if m["kind"] == "NetworkPolicy"]
    services = {m["metadata"]["name"] for m in DEPLOYMENTS}
    named = set(re.findall(r"'app.kubernetes.io/name': '([\w-]+)'", str(policies)))
    (nothing,) = (p for p in policies if not p["spec"]["podSelector"])
    assert nothing["spec"] == {"podSelector": {}, "policyTypes": ["Ingress", "Egress"]}
    allowed = {
        name
        for policy in policies
        for expression in policy["spec"]["podSelector"].get("matchExpressions", [])
        for name in expression["values"]
    }
    assert named == {"router", "learner"}
    assert allowed == services - {"router"}
    (among_learners,) = (p for p in policies if p["metadata"]["name"] == "learners")
    learners = {"matchLabels": {"app.kubernetes.io/name": "learner"}}
    spec = among_learners["spec"]
    peers = [spec["ingress"][0]["from"], spec["egress"][0]["to"]]
    assert spec["podSelector"] == learners
    assert peers == [[{"podSelector": learners}]] * 2  # with each other and nobody else


@pytest.mark.skipif(shutil.which("kubectl") is None, reason="kubectl renders, and is not here")
def test_kustomize_renders_all_of_it(tmp_path: Path) -> None:
    shutil.copytree(FOLDER, tmp_path / "kubernetes", ignore=shutil.ignore_patterns("certificates"))
    make(tmp_path / "kubernetes" / "certificates", days=1, server_names=["router"])
    done = subprocess.run(
        ["kubectl", "kustomize", str(tmp_path / "kubernetes")],
        capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    rendered = list(yaml.safe_load_all(done.stdout))
    assert len(rendered) == len(ALL) + len(KUSTOMIZATION["secretGenerator"])
    secrets = {m["metadata"]["name"] for m in rendered if m["kind"] == "Secret"}
    used = set(
        re.findall(r"certificates-[\w-]+", str([m for m in rendered if m["kind"] == "Deployment"]))
    )
    assert used == secrets
    for manifest in rendered:
        kubernetes_validate.validate(manifest, VERSIONS[-1], strict=True)
