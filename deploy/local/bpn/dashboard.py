"""The dashboard as the `bpn` command uses it: found by the file that it leaves in the runs folder."""

import json
from pathlib import Path
from typing import Any, Self

import httpx

from bpn_shared.config import ConfigError

ADDRESS_FILE = ".dashboard.json"
_TIMEOUT_S = 10.0
_FIND_TIMEOUT_S = 2.0


class DashboardError(RuntimeError):
    """The dashboard refused; the message is its reason, `status` the one of HTTP."""

    def __init__(self, reason: str, status: int) -> None:
        super().__init__(reason)
        self.status = status


class DashboardAwayError(RuntimeError):
    """The dashboard does not answer now."""


class Dashboard:
    """REST calls to a dashboard that runs.

    Attributes:
        url: where browsers reach it.
        endpoint: of the router that it and its workers use.
    """

    def __init__(self, url: str, token: str, endpoint: str) -> None:
        self.url, self.endpoint = url, endpoint
        self._http = httpx.Client(
            base_url=url, headers={"Authorization": f"Bearer {token}"}, timeout=_TIMEOUT_S
        )

    @classmethod
    def find(cls, runs_dir: Path) -> Self | None:
        """The dashboard of a runs folder; None if none runs."""
        try:
            address = json.loads((runs_dir / ADDRESS_FILE).read_bytes())
            found = cls(address["url"], address["token"], address["endpoint"])
            found._http.get("/healthz", timeout=_FIND_TIMEOUT_S).raise_for_status()
        except (OSError, ValueError, KeyError, httpx.HTTPError):
            return None
        return found

    def run_count(self) -> int:
        """How many runs there are, archived ones too."""
        count = 0
        for archived in ("false", "true"):
            answer = self._call("GET", "/runs", params={"limit": "1", "archived": archived})
            count += answer["total"]
        return count

    def create_run(self, config: dict[str, Any], name: str = "") -> dict[str, Any]:
        """Puts a new run into the queue.

        Args:
            config: the task, and what is changed from its preset.
        """
        return self._call("POST", "/runs", json={"config": config, "name": name})

    def run(self, run_id: str) -> dict[str, Any]:
        """A run as it is now."""
        return self._call("GET", f"/runs/{run_id}")

    def stop(self, run_id: str) -> dict[str, Any]:
        """Asks for the run's end; workers let go of it soon after."""
        return self._call("POST", f"/runs/{run_id}/stop")

    def resume(self, run_id: str) -> dict[str, Any]:
        """Puts a run back into the queue."""
        return self._call("POST", f"/runs/{run_id}/resume")

    def _call(self, method: str, path: str, **arguments: Any) -> dict[str, Any]:
        """One request.

        Raises:
            ConfigError: the dashboard refuses what was sent.
            DashboardError: it refuses for another reason.
            DashboardAwayError: it does not answer.
        """
        try:
            response = self._http.request(method, f"/api/v1{path}", **arguments)
        except httpx.HTTPError as error:
            raise DashboardAwayError(
                f"the dashboard at {self.url} does not answer: {error}"
            ) from error
        if response.is_success:
            answer: dict[str, Any] = response.json()
            return answer
        problem = response.json() if "json" in response.headers.get("content-type", "") else {}
        reason = str(problem.get("detail") or f"HTTP status {response.status_code}")
        reason = f"the dashboard at {self.url}: {reason}"
        if response.status_code in (400, 422):
            raise ConfigError(reason)
        raise DashboardError(reason, response.status_code)
