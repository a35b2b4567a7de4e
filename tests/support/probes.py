"""What a kubelet does with the probes of a manifest, done to containers."""

import subprocess
import time
import urllib.request
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml
from compose_project import COMMAND_TIMEOUT_S

MANIFESTS = Path(__file__).parents[2] / "deploy" / "kubernetes"
_DEFAULTS = {"periodSeconds": 10, "timeoutSeconds": 1, "failureThreshold": 3}


def probe_of(service: str, kind: str) -> dict[str, Any]:
    """A probe (`livenessProbe`, `readinessProbe`) of a service's manifest, with Kubernetes' defaults filled in."""
    path = MANIFESTS / f"{service.replace('_', '-')}.yaml"
    (deployment,) = (m for m in yaml.safe_load_all(path.read_text()) if m["kind"] == "Deployment")
    (container,) = deployment["spec"]["template"]["spec"]["containers"]
    return _DEFAULTS | container[kind]


@dataclass
class Probe:
    """One probe of one container.

    Attributes:
        port: where this machine reaches the port that an HTTP probe asks.
    """

    container: str
    what: dict[str, Any]
    port: int | None = None
    asked: int = 0
    failures: int = 0
    in_a_row: int = 0
    most_in_a_row: int = 0
    _next_s: float = 0.0

    @property
    def would_act(self) -> bool:
        """Whether the container would have been restarted, or sent nobody."""
        return self.most_in_a_row >= int(self.what["failureThreshold"])

    def look(self) -> None:
        """Asks, if its time has come."""
        if time.monotonic() < self._next_s:
            return
        self._next_s = time.monotonic() + float(self.what["periodSeconds"])
        self.asked += 1
        if self._succeeds():
            self.in_a_row = 0
            return
        self.failures += 1
        self.in_a_row += 1
        self.most_in_a_row = max(self.most_in_a_row, self.in_a_row)

    def _succeeds(self) -> bool:
        limit_s = self.what["timeoutSeconds"]
        if "httpGet" in self.what:
            get = self.what["httpGet"]
            headers = {header["name"]: header["value"] for header in get["httpHeaders"]}
            url = f"http://127.0.0.1:{self.port}{get['path']}"
            try:
                with urllib.request.urlopen(
                    urllib.request.Request(url, headers=headers), timeout=limit_s
                ) as answer:
                    return bool(200 <= answer.status < 400)
            except OSError:
                return False
        command = ["timeout", str(limit_s), *self.what["exec"]["command"]]
        done = subprocess.run(
            ["docker", "exec", self.container, *command],
            capture_output=True, timeout=COMMAND_TIMEOUT_S, check=False,
        )  # fmt: skip
        return done.returncode == 0
