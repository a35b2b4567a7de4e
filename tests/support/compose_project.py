"""compose.yaml under a name of its own, on whatever Docker Engine DOCKER_HOST names (25 or newer)."""

import json
import subprocess
import time
import urllib.request
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bpn_shared.bus.access import ROLES
from bpn_shared.version import VERSION

ROOT = Path(__file__).parents[2]
BUILD_TIMEOUT_S = 1800
UP_TIMEOUT_S = 180
COMMAND_TIMEOUT_S = 60
SERVICES = ("router", *ROLES)


class EngineError(RuntimeError):
    """A docker command failed, or hung."""


def docker(*arguments: str, timeout_s: float = COMMAND_TIMEOUT_S) -> str:
    """Runs docker; every call has a deadline, for an engine that hangs hangs its clients.

    Raises:
        EngineError: it failed or hung; the message has what it said.
    """
    return _run(["docker", *arguments], timeout_s)


def build_images() -> None:
    """The images of the sources as they are.

    Raises:
        EngineError: one cannot be built; the message has why.
    """
    _run(["make", "images"], BUILD_TIMEOUT_S)


def image(service: str) -> str:
    """The image of a service as compose.yaml calls it."""
    return f"bpn-{service.replace('_', '-')}:{VERSION}"


def _run(words: list[str], timeout_s: float) -> str:
    try:
        done = subprocess.run(
            words, capture_output=True, text=True, timeout=timeout_s, check=False, cwd=ROOT
        )
    except subprocess.TimeoutExpired as error:
        raise EngineError(f"{' '.join(words)}: no answer in {timeout_s:.0f} s") from error
    if done.returncode != 0:
        raise EngineError(f"{' '.join(words)}\n{done.stdout}{done.stderr}")
    return done.stdout


@dataclass(frozen=True)
class Project:
    """One start of compose.yaml under a name of its own."""

    name: str
    port: int
    files: tuple[str, ...] = ("compose.yaml",)

    def compose(self, *arguments: str, timeout_s: float = COMMAND_TIMEOUT_S) -> str:
        files = [option for file in self.files for option in ("-f", file)]
        return docker("compose", "-p", self.name, *files, *arguments, timeout_s=timeout_s)

    def up(self, *arguments: str) -> None:
        self.compose("up", "-d", "--wait", "--no-build", *arguments, timeout_s=UP_TIMEOUT_S)

    def containers(self, service: str) -> list[str]:
        """Ids of a service's running containers."""
        return self.compose("ps", "-q", service).split()

    def inspect(self, container: str) -> dict[str, Any]:
        details: list[dict[str, Any]] = json.loads(docker("inspect", container))
        return details[0]

    def state(self, container: str) -> dict[str, Any]:
        """Running, Pid, ExitCode, StartedAt, Health ..."""
        details: dict[str, Any] = self.inspect(container)["State"]
        return details

    def is_healthy(self, container: str) -> bool:
        state = self.state(container)
        return bool(state["Running"] and state["Health"]["Status"] == "healthy")

    def wait_well(self) -> None:
        """Waits until every service is well, without starting any: each has to come back by itself.

        Raises:
            AssertionError: some are not in time; the message has what they said last.
        """
        deadline_s = time.monotonic() + UP_TIMEOUT_S
        while sick := [service for service in SERVICES if not self._is_well(service)]:
            if time.monotonic() > deadline_s:
                said = self.compose("logs", "--tail", "20", *sick)
                raise AssertionError(f"{sick} not well after {UP_TIMEOUT_S} s:\n{said}")
            time.sleep(0.5)  # the condition is another machine's, as far as we know

    def _is_well(self, service: str) -> bool:
        return all(map(self.is_healthy, self.compose("ps", "-a", "-q", service).split()))

    def token(self) -> str:
        """The dashboard's token for scripts, as it is now: another one after each of its starts."""
        address = self.compose("exec", "-T", "dashboard", "cat", "/state/.dashboard.json")
        token: str = json.loads(address)["token"]
        return token

    def metrics(self, token: str) -> str:
        """What the dashboard tells Prometheus."""
        request = urllib.request.Request(
            f"http://127.0.0.1:{self.port}/metrics", headers={"Authorization": f"Bearer {token}"}
        )
        with urllib.request.urlopen(request, timeout=20) as answer:
            said: bytes = answer.read()
            return said.decode()

    def api(
        self, method: str, path: str, body: dict[str, Any] | None = None, token: str | None = None
    ) -> Any:
        """Calls the dashboard through its published port; asks it for its token if that is not given."""
        request = urllib.request.Request(
            f"http://127.0.0.1:{self.port}/api/v1{path}",
            method=method,
            data=None if body is None else json.dumps(body).encode(),
            headers={
                "Authorization": f"Bearer {token or self.token()}",
                "Content-Type": "application/json",
            },
        )
        with urllib.request.urlopen(request, timeout=20) as answer:
            return json.load(answer)

    def start_run(self, **config: Any) -> str:
        run: dict[str, Any] = self.api("POST", "/runs", {"config": {"task": "reaching", **config}})
        return str(run["id"])

    def wait_finished(self, run: str, timeout_s: float) -> dict[str, Any]:
        """Waits until a run is finished; a dashboard that is just coming back is asked again.

        Raises:
            AssertionError: it is not in time, or has failed.
        """
        deadline_s = time.monotonic() + timeout_s
        seen: object = "nothing was heard"
        while time.monotonic() < deadline_s:
            try:
                found: dict[str, Any] = self.api("GET", f"/runs/{run}")
            except (OSError, EngineError) as error:
                seen = error
            else:
                assert found["state"] != "failed", found["error"]
                if found["state"] == "finished":
                    return found
                seen = found
            time.sleep(0.5)  # the condition is another machine's, as far as we know
        raise AssertionError(f"run {run} is not finished after {timeout_s:.0f} s: {seen}")

    def down(self) -> None:
        """Ends it, with its volumes."""
        self.compose("down", "-v", "-t", "10", timeout_s=120)

    def left_over(self) -> str:
        """What of this project the engine still knows."""
        label = ["--filter", f"label=com.docker.compose.project={self.name}", "-q"]
        return "".join(
            docker(*kind, *label) for kind in (["ps", "-a"], ["volume", "ls"], ["network", "ls"])
        )
