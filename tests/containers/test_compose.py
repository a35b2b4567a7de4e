"""The loop in containers: it learns, it is locked down, it survives, and it leaves nothing."""

import json
import re
import subprocess
import time
from collections.abc import Callable

import pytest
from chaos import facts, kill_main
from compose_project import COMMAND_TIMEOUT_S, SERVICES, Project, docker, image

from bpn_shared.version import PROTOCOL, VERSION

WaitFor = Callable[..., None]

SMALL = {
    "iterations": 3,
    "episodes": 6,
    "epochs": 1,
    "hidden_units": 24,
    "replay_iterations": 2,
    "seed": 7,
}
RUN_TIMEOUT_S = 240.0
EDGE_BEYOND_BASE_BYTES = 150 * 1000**2


def weights_sha256(project: Project, run: str) -> object:
    return facts(project, run)["weights"]


@pytest.fixture(scope="module")
def undisturbed(project: Project) -> object:
    """Digest of the weights of a run that nobody disturbed, whose curve the dashboard shows."""
    run = project.start_run(**SMALL)
    finished = project.wait_finished(run, RUN_TIMEOUT_S)
    assert finished["iteration"] == SMALL["iterations"]
    query = {"runs": [run], "metrics": ["return_px"], "x": "iteration"}
    (curve,) = project.api("POST", "/series/query", query)["series"]
    assert len(curve["x"]) == SMALL["iterations"]
    assert all(value < 0 for value in curve["value"])
    return weights_sha256(project, run)


def test_a_run_finishes_and_the_dashboard_shows_its_curve(undisturbed: object) -> None:
    assert undisturbed


def test_the_log_says_where_the_dashboard_is(project: Project) -> None:
    log = project.compose("logs", "dashboard")
    assert f"bpn dashboard: http://localhost:{project.port}/#token=" in log


@pytest.mark.parametrize("service", SERVICES)
def test_a_container_is_locked_down(project: Project, service: str) -> None:
    (container,) = project.containers(service)
    details = project.inspect(container)
    host = details["HostConfig"]
    assert details["Config"]["User"] == "10001:10001"
    assert host["ReadonlyRootfs"]
    assert host["CapDrop"] == ["ALL"]
    assert "no-new-privileges:true" in host["SecurityOpt"]
    assert min(host["Memory"], host["PidsLimit"], host["NanoCpus"]) > 0
    assert host["LogConfig"]["Config"] == {"max-size": "10m", "max-file": "3"}
    assert host["RestartPolicy"]["Name"] == "unless-stopped"
    status = docker("exec", container, "cat", "/proc/self/status")
    assert "CapBnd:\t0000000000000000" in status
    assert "NoNewPrivs:\t1" in status
    writes = subprocess.run(
        ["docker", "exec", container, "touch", "/opt/venv/x"],
        capture_output=True, timeout=COMMAND_TIMEOUT_S, check=False,
    )  # fmt: skip
    assert writes.returncode != 0


@pytest.mark.parametrize("service", SERVICES)
def test_a_container_sees_its_own_certificates_alone(project: Project, service: str) -> None:
    (container,) = project.containers(service)
    mounts = {m["Destination"]: m for m in project.inspect(container)["Mounts"] if "Name" in m}
    certificates = mounts.pop("/certificates")
    assert certificates["Name"].endswith(f"_certificates-{service}")
    assert not certificates["RW"]
    others = {"dashboard": {"/runs", "/state", "/metrics"}, "learner": {"/runs"}}
    assert mounts.keys() == others.get(service, set())


def test_only_the_dashboard_can_be_reached_and_from_this_machine_alone(project: Project) -> None:
    published = {
        service: project.inspect(container)["HostConfig"]["PortBindings"]
        for service in SERVICES
        for container in project.containers(service)
    }
    assert published.pop("dashboard") == {
        "8000/tcp": [{"HostIp": "127.0.0.1", "HostPort": str(project.port)}]
    }
    assert not any(published.values())
    (network,) = json.loads(docker("network", "inspect", f"{project.name}_bus"))
    assert network["Internal"]


def test_who_has_no_certificate_is_not_let_in(project: Project) -> None:
    done = subprocess.run(
        ["docker", "run", "--rm", "--network", f"{project.name}_bus", image("edge"), "--connect=tls/router:7447"],
        capture_output=True, text=True, timeout=COMMAND_TIMEOUT_S, check=False,
    )  # fmt: skip
    assert done.returncode == 2
    assert "/certificates/authority.pem cannot be read" in done.stderr


@pytest.mark.usefixtures("images")
def test_the_edge_image_is_small_and_has_neither_torch_nor_mujoco_nor_a_compiler() -> None:
    probe = (
        "import importlib.util, shutil;"
        "print([n for n in ('torch', 'mujoco', 'cryptography', 'pip') if importlib.util.find_spec(n)],"
        "[c for c in ('gcc', 'g++', 'cc', 'clang', 'make') if shutil.which(c)])"
    )
    assert docker("run", "--rm", "--entrypoint", "python", image("edge"), "-c", probe) == "[] []\n"
    base, edge = (
        int(docker("image", "inspect", "-f", "{{.Size}}", name))
        for name in ("python:3.11-slim-bookworm", image("edge"))
    )
    assert edge - base < EDGE_BEYOND_BASE_BYTES


@pytest.mark.usefixtures("images")
@pytest.mark.parametrize("service", [*SERVICES, "certificates"])
def test_an_image_tells_its_version_and_commit(service: str) -> None:
    labels = json.loads(docker("image", "inspect", "-f", "{{json .Config.Labels}}", image(service)))
    told = {name.rpartition(".")[2]: value for name, value in labels.items()}
    program = f"bpn-{service.replace('_', '-')}"
    assert (told["title"], told["version"]) == (program, VERSION)
    assert re.fullmatch("[0-9a-f]{40}(-dirty)?", told["revision"])
    said = docker("run", "--rm", image(service), "--version")
    assert said == f"{program} {VERSION}, protocol {PROTOCOL}, commit {told['revision']}\n"


def test_a_run_tells_which_images_wrote_it(project: Project) -> None:
    run = project.start_run(**SMALL)
    project.api("POST", f"/runs/{run}/stop")
    config = project.compose("exec", "-T", "dashboard", "cat", f"/runs/{run}/config.json")
    writer = json.loads(config)["written_by"]
    revision = '{{index .Config.Labels "org.opencontainers.image.revision"}}'
    assert writer["version"] == VERSION
    assert (
        writer["commit"] == docker("image", "inspect", "-f", revision, image("dashboard")).strip()
    )


@pytest.mark.parametrize("service", SERVICES)
def test_a_killed_container_comes_back_and_the_run_ends_the_same(
    project: Project, undisturbed: object, wait_for: WaitFor, service: str
) -> None:
    run = project.start_run(**SMALL)
    wait_for(lambda: project.api("GET", f"/runs/{run}")["iteration"] >= 1, "an iteration", 120.0)
    (container,) = project.containers(service)
    before = project.state(container)
    kill_main(container)
    wait_for(
        lambda: project.state(container)["StartedAt"] != before["StartedAt"], "a restart", 60.0
    )
    wait_for(lambda: project.is_healthy(container), f"{service} to be well again", 60.0)
    project.wait_finished(run, RUN_TIMEOUT_S)
    assert weights_sha256(project, run) == undisturbed


def test_more_robots_are_a_matter_of_scale(project: Project, undisturbed: object) -> None:
    project.up("--scale", "edge=2", "--scale", "robot_sim=2", "--scale", "learner=2")
    assert [len(project.containers(s)) for s in ("edge", "robot_sim", "learner")] == [2, 2, 2]
    side_by_side = [project.start_run(**SMALL), project.start_run(**SMALL | {"robots": 2})]
    for run in side_by_side:
        project.wait_finished(run, 2 * RUN_TIMEOUT_S)
        assert weights_sha256(project, run) == undisturbed


def test_two_learners_share_a_run_and_one_may_die(project: Project, wait_for: WaitFor) -> None:
    project.up("--scale", "learner=2")
    shared = SMALL | {"learners": 2, "epochs": 5}
    first = project.start_run(**shared)
    project.wait_finished(first, RUN_TIMEOUT_S)
    run = project.start_run(**shared)
    wait_for(lambda: project.api("GET", f"/runs/{run}")["iteration"] >= 1, "an iteration", 120.0)
    kill_main(project.containers("learner")[0])
    project.wait_finished(run, RUN_TIMEOUT_S)
    assert weights_sha256(project, run) == weights_sha256(project, first)


def test_everything_stops_in_time_and_nothing_is_left(project: Project) -> None:
    containers = {s: project.containers(s) for s in SERVICES}
    start_s = time.monotonic()
    project.compose("stop", "-t", "30", timeout_s=120)
    print(f"stopped after {time.monotonic() - start_s:.1f} s")
    codes = {s: [project.state(c)["ExitCode"] for c in ids] for s, ids in containers.items()}
    assert {code for of_service in codes.values() for code in of_service} == {0}, codes
    project.compose("down", "-v", timeout_s=120)
    assert project.left_over() == ""
