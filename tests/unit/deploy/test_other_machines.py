"""Compose keeps its scale, and publishes the bus where it is asked to: the files as compose merges them."""

import json
import os
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest
import yaml

ROOT = Path(__file__).parents[3]
OVERRIDE = ROOT / "deploy/compose/other-machines.yaml"
COUNTS = {"learner": "BPN_LEARNERS", "edge": "BPN_EDGES", "robot_sim": "BPN_ROBOTS"}


class _Loader(yaml.SafeLoader):
    """Compose's own tags as plain values."""


def _plain(loader: yaml.SafeLoader, node: yaml.Node) -> Any:
    if isinstance(node, yaml.MappingNode):
        return loader.construct_mapping(node, deep=True)
    if isinstance(node, yaml.SequenceNode):
        return loader.construct_sequence(node, deep=True)
    return None


for _tag in ("!reset", "!override"):
    _Loader.add_constructor(_tag, _plain)


def services(file: Path) -> dict[str, Any]:
    found: dict[str, Any] = yaml.load(file.read_text(), _Loader)["services"]
    return found


@pytest.mark.parametrize(("service", "variable"), COUNTS.items())
def test_how_many_there_are_is_kept_in_a_variable(service: str, variable: str) -> None:
    assert services(ROOT / "compose.yaml")[service]["deploy"]["replicas"] == f"${{{variable}:-1}}"
    assert f"# {variable}=" in (ROOT / ".env").read_text()


def test_the_bus_is_published_by_the_override_alone() -> None:
    assert "ports" not in services(ROOT / "compose.yaml")["router"]
    override = services(OVERRIDE)
    published = [port.split(":")[-1] for port in override["router"]["ports"]]
    published += [port.split(":")[-1] for port in override["enrolment"]["ports"]]
    assert published == ["7447", "7448"]


def test_enrolment_sees_the_authority_and_the_router_and_nobody_elses_key() -> None:
    volumes = services(OVERRIDE)["enrolment"]["volumes"]
    assert [volume.split(":")[0] for volume in volumes] == [
        "certificates-authority",
        "certificates-router",
    ]
    assert services(OVERRIDE)["enrolment"]["extends"]["service"] == "certificates"  # locked down


def test_compose_takes_them() -> None:
    """Where it is installed; elsewhere the files are seen by the tests above alone."""
    if shutil.which("docker") is None:
        return
    options = ["-f", "compose.yaml", "-f", str(OVERRIDE.relative_to(ROOT))]
    done = subprocess.run(
        ["docker", "compose", *options, "config", "--format", "json"],
        cwd=ROOT, capture_output=True, text=True, timeout=60, check=False,
        env={**os.environ, "BPN_SERVER_NAMES": "a.example", "BPN_EDGES": "3"},
    )  # fmt: skip
    if "compose" in done.stderr and "is not a docker command" in done.stderr:
        return
    assert done.returncode == 0, done.stderr
    merged = json.loads(done.stdout)["services"]
    assert merged["edge"]["deploy"]["replicas"] == 3
    assert merged["edge"]["deploy"]["resources"]["limits"]
    assert "network_mode" not in merged["enrolment"]
    assert merged["enrolment"]["read_only"] is True
    assert set(merged["router"]["networks"]) == {"bus", "web"}
