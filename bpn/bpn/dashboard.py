"""The dashboard as the `bpn` command uses it: found by the file that it leaves in the runs folder."""

import json
import ssl
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Self

import httpx

from bpn.errors import CommandError
from bpn_shared.errors import InputError

ADDRESS_FILE = ".dashboard.json"
_TIMEOUT_S = 10.0
_FIND_TIMEOUT_S = 2.0
_PAGE = 200
_PRUNE_TIMEOUT_S = 600.0
_CREATE_TIMEOUT_S = 90.0
"""A robot worker may have to open an environment first."""


class DashboardError(CommandError):
    """The dashboard refused; the message is its reason, `status` the one of HTTP."""

    def __init__(self, reason: str, status: int) -> None:
        super().__init__(reason)
        self.status = status


class DashboardAwayError(CommandError):
    """The dashboard does not answer now."""


class Dashboard:
    """REST calls to a dashboard that runs; docs/dashboard-api.md says what each takes and gives.

    Args:
        url: such as http://127.0.0.1:8000.
        token: one that an admin made, or the one in the runs folder's .dashboard.json.
        certificate: file with the one that it shows; None: it speaks plain HTTP.

    Attributes:
        url: where browsers reach it.
        endpoint: of the router that it and its workers use.
    """

    def __init__(
        self, url: str, token: str = "", endpoint: str = "", certificate: str | None = None
    ) -> None:
        self.url, self.endpoint = url, endpoint
        self._http = httpx.Client(
            base_url=url,
            headers={"Authorization": f"Bearer {token}"} if token else {},
            timeout=_TIMEOUT_S,
            verify=_trust(certificate),
        )

    @classmethod
    def find(cls, runs_dir: Path | str) -> Self | None:
        """The dashboard of a runs folder; None if none runs."""
        try:
            address = json.loads((Path(runs_dir) / ADDRESS_FILE).read_bytes())
            certificate = address.get("certificate")
            found = cls(address["url"], address["token"], address["endpoint"], certificate)
            # With the token: the file may be of one that was killed, whose port the next one has.
            found._http.get("/api/v1/session", timeout=_FIND_TIMEOUT_S).raise_for_status()
            return found
        except (OSError, ValueError, KeyError, httpx.HTTPError):
            return None

    def run_count(self) -> int:
        """How many runs there are, archived ones too."""
        count = 0
        for archived in ("false", "true"):
            answer = self._call("GET", "/runs", params={"limit": "1", "archived": archived})
            count += answer["total"]
        return count

    def runs(self, **query: str) -> dict[str, Any]:
        """A page of runs: `items`, `next_cursor`, `total`.

        Args:
            query: filter, order and page, as docs/dashboard-api.md has them.
        """
        return self._call("GET", "/runs", params=query)

    def listed(self, query: Mapping[str, str], limit: int) -> tuple[list[dict[str, Any]], int]:
        """The first `limit` runs of a query, and how many it has.

        Args:
            query: search, state, archived, sort: as docs/dashboard-api.md has them.
        """
        items: list[dict[str, Any]] = []
        page: dict[str, Any] = {"next_cursor": "", "total": 0}
        while len(items) < limit and page["next_cursor"] is not None:
            cursor = {"cursor": page["next_cursor"]} if page["next_cursor"] else {}
            size = str(min(_PAGE, limit - len(items)))
            page = self.runs(**query, **cursor, limit=size)
            items += page["items"]
        return items, page["total"]

    def named(self, text: str) -> dict[str, Any]:
        """The run of that id, or of which it is the unique beginning or end.

        Raises:
            InputError: there is none, or there are several.
        """
        found = [
            run
            for archived in ("false", "true")
            for run in self.runs(search=text, archived=archived, limit="200")["items"]
            if run["id"].startswith(text) or run["id"].endswith(text)
        ]
        if len(found) != 1:
            count = f"{len(found)} runs match" if found else "no run matches"
            raise InputError(f"{count} {text!r}; `bpn runs ls` shows them")
        return dict(found[0])

    def create_run(
        self, config: dict[str, Any], name: str = "", tags: Sequence[str] = ()
    ) -> dict[str, Any]:
        """Puts a new run into the queue.

        Args:
            config: the task, and what is changed from its preset.
        """
        body = {"config": config, "name": name, "tags": list(tags)}
        return self._call("POST", "/runs", json=body, timeout=_CREATE_TIMEOUT_S)

    def metrics(self, run_id: str) -> list[str]:
        """The names of a run's metrics."""
        return [item["name"] for item in self._call("GET", f"/runs/{run_id}/metrics")["names"]]

    def export(self, run_ids: Sequence[str], metrics: Sequence[str], form: str) -> Iterator[bytes]:
        """Every point of the metrics, as pieces of a file.

        Raises:
            DashboardError: it refuses.
            DashboardAwayError: it does not answer.
        """
        query = {"runs": ",".join(run_ids), "metrics": ",".join(metrics), "format": form}
        try:
            with self._http.stream("GET", "/api/v1/series/export", params=query) as response:
                if not response.is_success:
                    response.read()
                    raise self._refusal(response)
                yield from response.iter_bytes()
        except httpx.HTTPError as error:
            raise self._away(error) from error

    def run(self, run_id: str) -> dict[str, Any]:
        """A run as it is now."""
        return self._call("GET", f"/runs/{run_id}")

    def stop(self, run_id: str) -> dict[str, Any]:
        """Asks for the run's end; workers let go of it soon after."""
        return self._call("POST", f"/runs/{run_id}/stop")

    def resume(self, run_id: str) -> dict[str, Any]:
        """Puts a run back into the queue."""
        return self._call("POST", f"/runs/{run_id}/resume")

    def remove(self, run_id: str) -> dict[str, Any]:
        """Moves a run to the trash; returns it as it lies there."""
        return self._call("DELETE", f"/runs/{run_id}")

    def restore(self, run_id: str) -> dict[str, Any]:
        """Brings a run back from the trash."""
        return self._call("POST", f"/trash/{run_id}/restore")

    def trash(self) -> list[dict[str, Any]]:
        """What is in the trash, those removed last first."""
        return list(self._call("GET", "/trash")["items"])

    def prune(
        self, keep: int | None, older_than_days: float | None, *, dry_run: bool
    ) -> list[dict[str, Any]]:
        """Moves old runs to the trash; returns what became of each."""
        body = {"keep": keep, "older_than_days": older_than_days, "dry_run": dry_run}
        items = self._call("POST", "/runs/prune", json=body, timeout=_PRUNE_TIMEOUT_S)["items"]
        return [
            {key: item[key] for key in ("id", "name", "ok")}
            | {"trouble": (item["problem"] or {}).get("detail", "")}
            for item in items
        ]

    def _call(self, method: str, path: str, **arguments: Any) -> dict[str, Any]:
        """One request.

        Raises:
            InputError: the dashboard refuses what was sent.
            DashboardError: it refuses for another reason.
            DashboardAwayError: it does not answer.
        """
        try:
            response = self._http.request(method, f"/api/v1{path}", **arguments)
        except httpx.HTTPError as error:
            raise self._away(error) from error
        if not response.is_success:
            raise self._refusal(response)
        answer: dict[str, Any] = response.json()
        return answer

    def _away(self, error: httpx.HTTPError) -> DashboardAwayError:
        return DashboardAwayError(f"the dashboard at {self.url} does not answer: {error}")

    def _refusal(self, response: httpx.Response) -> InputError | DashboardError:
        problem = response.json() if "json" in response.headers.get("content-type", "") else {}
        reason = str(problem.get("detail") or f"HTTP status {response.status_code}")
        wrong = [f"{item['location']}: {item['message']}" for item in problem.get("errors", ())]
        reason = "\n".join([f"the dashboard at {self.url}: {reason}", *wrong])
        if response.status_code in (400, 422):
            return InputError(reason)
        return DashboardError(reason, response.status_code)


def _trust(certificate: str | None) -> ssl.SSLContext | bool:
    """Trusts that certificate itself, whoever signed it: it may be self-made."""
    if certificate is None:
        return True
    context = ssl.create_default_context(cafile=certificate)
    context.verify_flags |= ssl.VERIFY_X509_PARTIAL_CHAIN
    return context
