"""The manifests: valid for several versions of Kubernetes, hardened, and of one piece with the containers."""

import base64
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
from bpn_shared.version import VERSION

FOLDER = Path(__file__).parents[3] / "deploy" / "kubernetes"
VERSIONS = ["1.30", "1.33", "1.37"]
Manifest = dict[str, Any]


def manifests() -> Iterator[Manifest]:
    for path in sorted(FOLDER.glob("*.yaml")):
        if path.name != "kustomization.yaml":
            yield from yaml.safe_load_all(path.read_text())


ALL = list(manifests())
DEPLOYMENTS = [m for m in ALL if m["kind"] == "Deployment"]
SERVICES = [role.replace("_", "-") for role in ("router", *ROLES)]
COMPONENTS = [path.name for path in sorted((FOLDER / "components").iterdir())]
KEYS = {"ca.crt": AUTHORITY, "tls.crt": CERTIFICATE, "tls.key": KEY}
"""Of a secret: the file that a pod finds it as."""
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
    assert {m["metadata"]["name"] for m in DEPLOYMENTS} == set(SERVICES)


def test_images_are_of_this_version_and_taken_from_the_node_if_they_are_there() -> None:
    images = {image["name"]: image["newTag"] for image in KUSTOMIZATION["images"]}
    assert images == {f"bpn-{service}": VERSION for service in SERVICES}
    for deployment in DEPLOYMENTS:
        (container,) = deployment["spec"]["template"]["spec"]["containers"]
        assert container["imagePullPolicy"] == "IfNotPresent"


@pytest.mark.parametrize("deployment", DEPLOYMENTS, ids=name_of)
def test_a_deployment_is_hardened_and_sees_its_own_certificates_alone(deployment: Manifest) -> None:
    name = deployment["metadata"]["name"]
    pod = deployment["spec"]["template"]["spec"]
    assert pod["securityContext"]["runAsNonRoot"]
    assert not pod["automountServiceAccountToken"]
    assert pod["terminationGracePeriodSeconds"] == 30
    (container,) = pod["containers"]
    assert container["image"] == f"bpn-{name}"
    security = container["securityContext"]
    assert security["readOnlyRootFilesystem"]
    assert not security["allowPrivilegeEscalation"]
    assert security["capabilities"] == {"drop": ["ALL"]}
    for amounts in (container["resources"]["requests"], container["resources"]["limits"]):
        assert amounts.keys() == {"cpu", "memory", "ephemeral-storage"}
    assert {"startupProbe", "readinessProbe", "livenessProbe"} <= container.keys()
    (secret,) = (v["secret"] for v in pod["volumes"] if "secret" in v)
    assert secret["secretName"] == f"certificates-{name}"
    assert {item["key"]: item["path"] for item in secret["items"]} == KEYS
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


def test_who_mounts_the_runs_is_where_they_are_for_one_node_alone_may_mount_them() -> None:
    (runs,) = (m for m in ALL if name_of(m) == "PersistentVolumeClaim-runs")
    assert runs["spec"]["accessModes"] == ["ReadWriteOnce"]
    for deployment in DEPLOYMENTS:
        pod = deployment["spec"]["template"]
        mounts = "'claimName': 'runs'" in str(pod["spec"]["volumes"])
        assert (pod["metadata"]["labels"].get("bpn/mounts") == "runs") == mounts
        # A pod that itself has the label may be the first.
        wanted = pod["spec"].get("affinity", {}).get("podAffinity", {})
        terms = wanted.get("requiredDuringSchedulingIgnoredDuringExecution", [])
        assert [t["labelSelector"]["matchLabels"] for t in terms] == [
            {"bpn/mounts": "runs"}
        ] * mounts


def test_drained_nodes_take_workers_one_by_one_and_are_not_kept_from_it() -> None:
    budgets = [m for m in ALL if m["kind"] == "PodDisruptionBudget"]
    chosen = {m["spec"]["selector"]["matchLabels"]["app.kubernetes.io/name"] for m in budgets}
    assert chosen == set(SERVICES) - {"router", "dashboard"}
    for budget in budgets:
        assert budget["spec"]["maxUnavailable"] == 1
        assert budget["spec"]["unhealthyPodEvictionPolicy"] == "AlwaysAllow"


def test_network_policies_name_pods_that_exist_and_let_everyone_reach_the_router() -> None:
    policies = [m for m in ALL if m["kind"] == "NetworkPolicy"]
    named = set(re.findall(r"'app.kubernetes.io/name': '([\w-]+)'", str(policies)))
    (nothing,) = (p for p in policies if not p["spec"]["podSelector"])
    assert nothing["spec"] == {"podSelector": {}, "policyTypes": ["Ingress", "Egress"]}
    allowed = {
        name
        for policy in policies
        for expression in policy["spec"]["podSelector"].get("matchExpressions", [])
        for name in expression["values"]
    }
    assert named == {"router", "learner", "dashboard"}
    assert allowed == set(SERVICES) - {"router"}
    (metrics,) = (p["spec"]["ingress"] for p in policies if p["metadata"]["name"] == "metrics")
    (rule,) = metrics
    assert rule["from"] == [{"namespaceSelector": {"matchLabels": {"bpn/metrics": "read"}}}]
    (among_learners,) = (p for p in policies if p["metadata"]["name"] == "learners")
    learners = {"matchLabels": {"app.kubernetes.io/name": "learner"}}
    spec = among_learners["spec"]
    peers = [spec["ingress"][0]["from"], spec["egress"][0]["to"]]
    assert spec["podSelector"] == learners
    assert peers == [[{"podSelector": learners}]] * 2  # with each other and nobody else


renders = pytest.mark.skipif(
    shutil.which("kubectl") is None, reason="kubectl renders, and is not here"
)


def render(folder: Path) -> list[Manifest]:
    done = subprocess.run(
        ["kubectl", "kustomize", str(folder)],
        capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return list(yaml.safe_load_all(done.stdout))


def with_component(component: str, folder: Path) -> list[Manifest]:
    shutil.copytree(FOLDER, folder / "kubernetes")
    choice = {"components": [f"components/{component}"]}
    path = folder / "kubernetes" / "kustomization.yaml"
    path.write_text(yaml.safe_dump(KUSTOMIZATION | choice))
    return render(folder / "kubernetes")


@renders
def test_kustomize_renders_all_of_it() -> None:
    rendered = render(FOLDER)
    assert sorted(map(name_of, rendered)) == sorted(map(name_of, ALL))
    for manifest in rendered:
        kubernetes_validate.validate(manifest, VERSIONS[-1], strict=True)
        if manifest["kind"] not in ("Namespace", "PriorityClass"):
            assert manifest["metadata"]["namespace"] == "bpn"
        if manifest["kind"] == "Deployment":
            (container,) = manifest["spec"]["template"]["spec"]["containers"]
            assert container["image"].endswith(f":{VERSION}")


@renders
def test_the_secrets_are_what_pods_mount_and_each_has_its_own_key_alone(tmp_path: Path) -> None:
    make(tmp_path, days=1, server_names=["router"])
    said = subprocess.run(
        [FOLDER / "secrets.sh", tmp_path], capture_output=True, text=True, timeout=60, check=True
    )
    secrets = [m for m in yaml.safe_load_all(said.stdout) if m]
    assert [m["metadata"]["name"] for m in secrets] == [f"certificates-{s}" for s in SERVICES]
    for role, secret in zip(("router", *ROLES), secrets, strict=True):
        kubernetes_validate.validate(secret, VERSIONS[-1], strict=True)
        assert secret["metadata"]["namespace"] == "bpn"
        assert secret["type"] == "kubernetes.io/tls"
        held = {KEYS[key]: base64.b64decode(value) for key, value in secret["data"].items()}
        assert held == {file: (tmp_path / role / file).read_bytes() for file in KEYS.values()}


@renders
def test_cert_manager_makes_the_same_secrets_for_the_same_names(tmp_path: Path) -> None:
    rendered = with_component("cert-manager", tmp_path)
    made = {
        m["spec"]["secretName"]: m["spec"]
        for m in rendered
        if m["kind"] == "Certificate" and not m["spec"].get("isCA")
    }
    assert made.keys() == {f"certificates-{service}" for service in SERVICES}
    names = {secret: spec["commonName"] for secret, spec in made.items()}
    assert names == {f"certificates-{role.replace('_', '-')}": role for role in ("router", *ROLES)}
    servers = {secret for secret, spec in made.items() if "server auth" in spec["usages"]}
    assert servers == {"certificates-router"}
    assert "router" in made["certificates-router"]["dnsNames"]


@renders
def test_on_several_nodes_the_runs_are_shared_and_pods_go_where_they_like(tmp_path: Path) -> None:
    rendered = with_component("several-nodes", tmp_path)
    (runs,) = (m for m in rendered if name_of(m) == "PersistentVolumeClaim-runs")
    assert runs["spec"]["accessModes"] == ["ReadWriteMany"]
    assert "podAffinity" not in str(rendered)
    for manifest in rendered:
        kubernetes_validate.validate(manifest, VERSIONS[-1], strict=True)


def test_every_component_is_named_where_it_is_chosen() -> None:
    chosen = (FOLDER / "kustomization.yaml").read_text()
    assert all(f"components/{component}" in chosen for component in COMPONENTS)
