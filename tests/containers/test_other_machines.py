"""A robot's machine in a container of its own joins the containers of the first one, by the page's commands."""

import subprocess
import uuid
from collections.abc import Callable, Iterator

import pytest
from compose_project import BUILD_TIMEOUT_S, COMMAND_TIMEOUT_S, ROOT, Project, docker, image

WaitFor = Callable[..., None]
SMALL = {"iterations": 2, "episodes": 4, "epochs": 1, "hidden_units": 24, "seed": 7}
RUN_TIMEOUT_S = 240.0
MACHINE = ("--project-directory", ".", "-f", "deploy/compose/machine.yaml")


def address_of_this_machine() -> str:
    """By which containers of other networks reach what is published here."""
    form = "{{(index .IPAM.Config 0).Gateway}}"
    return docker("network", "inspect", "bridge", "--format", form).strip()


@pytest.fixture(scope="module")
def published() -> Iterator[None]:
    """What `.env` would say of a bus for other machines, and of no robots and edges here."""
    with pytest.MonkeyPatch.context() as patch:
        for variable in ("BPN_SERVER_NAMES", "BPN_BUS_ADDRESS"):
            patch.setenv(variable, address_of_this_machine())
        for variable in ("BPN_EDGES", "BPN_ROBOTS"):
            patch.setenv(variable, "0")
        yield


@pytest.fixture(scope="module")
def center(published: None, start: Callable[..., Project]) -> Project:  # noqa: ARG001 - it has to last longer
    """The loop without robots and edges, its bus published."""
    return start("deploy/compose/other-machines.yaml")


@pytest.fixture
def machine() -> Iterator[Callable[[str], str]]:
    """Starts a robot's machine with a token; tells its container."""
    docker("compose", *MACHINE, "build", timeout_s=BUILD_TIMEOUT_S)
    project = f"bpn-test-{uuid.uuid4().hex[:8]}"
    with pytest.MonkeyPatch.context() as patch:

        def begin(token: str) -> str:
            patch.setenv("BPN_TOKEN", token)
            patch.setenv("BPN_ROBOTS", "1")
            docker("compose", "-p", project, *MACHINE, "up", "-d")
            return docker("compose", "-p", project, *MACHINE, "ps", "-q", "machine").strip()

        yield begin
        docker("compose", "-p", project, *MACHINE, "down", "-v", "-t", "10")


def invite(center: Project, name: str) -> str:
    words = ("exec", "-T", "enrolment", "bpn-invite", "/certificates", "--name", name)
    return center.compose(*words).split()[-1]


def test_a_machine_joins_plays_a_run_and_goes_on_after_a_restart(
    center: Project, machine: Callable[[str], str]
) -> None:
    assert not center.containers("robot_sim")
    assert not center.containers("edge")
    token = invite(center, "pi-7")
    container = machine(token)
    assert center.wait_finished(center.start_run(**SMALL), RUN_TIMEOUT_S)["iteration"] == 2
    docker("restart", container, timeout_s=COMMAND_TIMEOUT_S)
    assert center.wait_finished(center.start_run(**SMALL), RUN_TIMEOUT_S)["iteration"] == 2
    said = subprocess.run(
        ["docker", "logs", container], capture_output=True, text=True, timeout=60, check=True
    )
    assert "this machine is pi-7 at site pi-7" in said.stdout
    other = subprocess.run(
        ["docker", "run", "--rm", image("machine"), token],
        capture_output=True, text=True, timeout=COMMAND_TIMEOUT_S, check=False, cwd=ROOT,
    )  # fmt: skip
    assert other.returncode == 2
    assert "the token was used at" in other.stderr
    assert other.stderr.count("\n") == 1
