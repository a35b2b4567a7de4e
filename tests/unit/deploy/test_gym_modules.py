"""Which modules robots may import is told them wherever they run, and nothing is allowed until somebody does."""

import os
import re
from pathlib import Path

import pytest
import yaml

from bpn_shared.runtime.gym_modules import VARIABLE, allowed_modules

ROOT = Path(__file__).parents[3]
COMPOSE = yaml.safe_load((ROOT / "compose.yaml").read_text())
ROBOT = yaml.safe_load((ROOT / "deploy/kubernetes/robot-sim.yaml").read_text())


def interpolated(text: str) -> str:
    """As compose fills variables in."""
    return re.sub(r"\$\{(\w+)-([^}]*)\}", lambda m: os.environ.get(m[1], m[2]), text)


@pytest.mark.parametrize(
    ("told", "allowed"), [(None, set()), ("minigrid,ale_py", {"minigrid", "ale_py"})]
)
def test_compose_tells_robots_alone(
    told: str | None, allowed: set[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv(VARIABLE, raising=False)
    if told is not None:
        monkeypatch.setenv(VARIABLE, told)
    who = [n for n, one in COMPOSE["services"].items() if VARIABLE in one.get("environment", {})]
    assert who == ["robot_sim"]
    monkeypatch.setenv(
        VARIABLE, interpolated(COMPOSE["services"]["robot_sim"]["environment"][VARIABLE])
    )
    assert allowed_modules() == allowed


def test_the_robots_image_takes_in_what_is_allowed() -> None:
    (argument,) = re.findall(
        r"^ARG (\w+)=$(?=(?:\n(?!FROM).*)*\n +\$PIP .* \$\1$)",
        (ROOT / "deploy/compose/Dockerfile").read_text(), re.MULTILINE,
    )  # fmt: skip
    assert interpolated(COMPOSE["services"]["robot_sim"]["build"]["args"][argument]) == ""


def test_kubernetes_allows_nothing_until_it_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    (container,) = ROBOT["spec"]["template"]["spec"]["containers"]
    (variable,) = [one for one in container["env"] if one["name"] == VARIABLE]
    monkeypatch.setenv(VARIABLE, variable["value"])
    assert allowed_modules() == frozenset()
