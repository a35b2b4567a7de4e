"""The dashboard as a process: killed, stopped, and asked by the command line."""

import contextlib
import json
import os
import signal
import ssl
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from uuid import UUID

import httpx
import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from bpn.cli import main
from bpn.dashboard import Dashboard
from bpn_certificates.authority import Validity, issue, new_authority
from bpn_dashboard.state_lock import ADDRESS_FILE
from bpn_shared.runs.folder import RunFolder
from bpn_shared.runs.trash import Trash
from bpn_shared.spec.config import RunConfig

DEADLINE_S = 60.0


@contextlib.contextmanager
def dashboard(
    runs_dir: Path, wait_for, *options: str, state_dir: Path | None = None
) -> Iterator[tuple[subprocess.Popen[str], httpx.Client, str]]:
    """A dashboard, a client with its token, and the one-time token that it printed.

    Unless the options name a router, it has no message bus.
    """
    state = () if state_dir is None else ("--state-dir", str(state_dir))
    with subprocess.Popen(
        [sys.executable, "-m", "bpn_dashboard", "--runs-dir", str(runs_dir), "--port", "0",
         "--connect", f"unixsock-stream/{runs_dir}/no-router", *state, *options],
        stdout=subprocess.PIPE, text=True,
    ) as process:  # fmt: skip
        try:
            assert process.stdout is not None
            link = process.stdout.readline().strip().partition("#token=")[2]
            found: list[Dashboard] = []

            def answers() -> bool:
                found[:] = filter(None, [Dashboard.find(state_dir or runs_dir)])
                return bool(found)

            wait_for(answers, "the dashboard to answer", DEADLINE_S)
            with contextlib.closing(found[0]._http) as client:
                yield process, client, link
        finally:
            process.kill()


def losses(client: httpx.Client, run: str) -> list[float]:
    body = {"runs": [run], "metrics": ["loss"], "max_points": 4000}
    answer = client.post("/api/v1/series/query", json=body)
    return answer.json()["series"][0]["x"] if answer.is_success else []


def test_kill_9_loses_no_point_and_a_stop_ends_open_streams(tmp_path, wait_for) -> None:
    run = "01a201f9-821b-74c6-95eb-3f4ab1331c4c"
    folder = RunFolder.create(tmp_path, run, RunConfig.for_task("reaching"))

    def write(begin: int, end: int) -> None:
        for iteration in range(begin, end):
            folder.append_metrics({"iteration": iteration, "loss": float(iteration)})

    write(0, 100)
    with dashboard(tmp_path, wait_for) as (process, client, _):
        wait_for(lambda: len(losses(client, run)) >= 100, "the first points", DEADLINE_S)
        write(100, 400)  # taken in while it dies
        of_the_killed = client.headers["Authorization"]
        process.send_signal(signal.SIGKILL)
        process.wait(DEADLINE_S)
    write(400, 500)
    with dashboard(tmp_path, wait_for) as (process, client, link):
        wait_for(lambda: len(losses(client, run)) >= 500, "all points", DEADLINE_S)
        assert losses(client, run) == list(range(500))

        headers = {"Authorization": of_the_killed}
        assert httpx.get(f"{client.base_url}/api/v1/session", headers=headers).status_code == 401

        cookie = log_in(client, link)
        url = str(client.base_url).replace("http", "ws") + "/api/v1/live"
        origin = str(client.base_url)
        with pytest.raises(InvalidStatus) as foreign:
            connect(
                url, origin="http://evil.example", additional_headers={"Cookie": cookie}
            ).close()
        assert foreign.value.response.status_code == 403
        with connect(url, origin=origin) as socket:
            with pytest.raises(ConnectionClosed):
                socket.recv(DEADLINE_S)
            assert socket.close_code == 4401
        with client.stream("GET", f"/api/v1/artefacts/{run}.metrics.metrics") as stream:
            process.send_signal(signal.SIGTERM)
            assert process.wait(DEADLINE_S) == 0
            stream.close()
    assert not (tmp_path / ADDRESS_FILE).exists()


def log_in(client: httpx.Client, link: str) -> str:
    """The cookie of a session made from the printed link."""
    answer = httpx.post(f"{client.base_url}/api/v1/session", json={"token": link})
    assert answer.status_code == 204, answer.text
    return answer.headers["set-cookie"].partition(";")[0]


def test_runs_are_started_listed_and_exported_from_the_command_line(
    tmp_path, wait_for, capsys
) -> None:
    def bpn(*arguments: str, status: int = 0) -> str:
        assert main(["runs", *arguments, "--runs-dir", str(tmp_path)]) == status
        said = capsys.readouterr()
        return said.out if status == 0 else said.err

    with dashboard(tmp_path, wait_for):
        assert oct((tmp_path / ADDRESS_FILE).stat().st_mode)[-3:] == "600"
        made = json.loads(bpn("start", "reaching", "--seed", "7", "--name", "mine", "--json"))
        RunFolder.open(tmp_path, made["id"]).append_metrics({"iteration": 0, "loss": 0.5})
        assert json.loads(bpn("ls", "--json"))[0]["id"] == made["id"]
        assert "mine" in bpn("show", made["id"][-8:])
        assert json.loads(bpn("stop", made["id"][-8:], "--json"))["state"] == "stopped"
        output = tmp_path / "series.csv"

        def exported() -> bool:
            arguments = ["--metrics", "loss", "--output", str(output), "--runs-dir", str(tmp_path)]
            if main(["runs", "export", made["id"], *arguments]) != 0:
                return False  # no run has that metric yet
            return ",0,0.5" in output.read_text()

        wait_for(exported, "the point in the export", DEADLINE_S)
        rest_of_id = made["id"][-8:]
        (removed,) = json.loads(bpn("rm", rest_of_id, "--json"))
        assert (removed["id"], removed["removed_by"]) == (made["id"], "local commands")
        assert "is in the trash: `bpn runs restore" in bpn("rm", rest_of_id, status=2)
        assert [item["id"] for item in json.loads(bpn("trash", "--json"))] == [made["id"]]
        assert json.loads(bpn("ls", "--json")) == []
        assert json.loads(bpn("restore", rest_of_id, "--json"))[0]["name"] == "mine"

        def seen() -> list[str]:
            return [item["id"] for item in json.loads(bpn("ls", "--json"))]

        assert seen() == [made["id"]]
        Trash(tmp_path).put(made["id"], "another machine")  # which does not find the dashboard
        assert "is in the trash" in bpn("rm", rest_of_id, status=2)
        (pruned,) = json.loads(bpn("restore", rest_of_id, "--json"))
        assert json.loads(bpn("prune", "--keep", "0", "--json"))[0]["id"] == pruned["id"]
        assert json.loads(bpn("empty-trash", "--json")) == [{"id": made["id"]}]
    assert "bpn up" in bpn("start", "reaching", status=2)
    assert json.loads(bpn("ls", "--json")) == []


def test_the_first_run_is_started_once_and_metrics_have_a_token_of_their_own(
    tmp_path, wait_for
) -> None:
    token = tmp_path / "metrics-token"
    for _ in range(2):
        with dashboard(
            tmp_path, wait_for, "--first-run", "tracking", "--metrics-token", str(token)
        ) as (process, client, _):
            (run,) = client.get("/api/v1/runs").json()["items"]
            assert (run["name"], run["task"], run["state"]) == ("first run", "tracking", "queued")
            viewer = {"Authorization": f"Bearer {token.read_text()}"}
            metrics = client.get("/metrics", headers=viewer)
            assert 'bpn_runs{state="queued"} 1.0' in metrics.text
            assert client.post(f"/api/v1/runs/{run['id']}/stop", headers=viewer).status_code == 403
            process.terminate()
            assert process.wait(DEADLINE_S) == 0


def test_database_and_token_can_be_kept_from_those_who_share_the_runs(tmp_path, wait_for) -> None:
    runs, state = tmp_path / "runs", tmp_path / "state"
    for _ in range(2):  # the second one finds the database
        with dashboard(runs, wait_for, "--first-run", "reaching", state_dir=state) as (
            _,
            client,
            _,
        ):
            (run,) = client.get("/api/v1/runs").json()["items"]
            assert {path.name for path in runs.iterdir()} == {run["id"], ".trash"}
            assert oct((state / ADDRESS_FILE).stat().st_mode)[-3:] == "600"


def test_behind_another_port_it_tells_the_public_url_and_answers_to_its_name(
    tmp_path, wait_for, free_tcp_port
) -> None:
    port = free_tcp_port()
    url = "https://robots.example.org:8443"
    options = [sys.executable, "-m", "bpn_dashboard", "--runs-dir", str(tmp_path)]
    options += ["--port", str(port), "--connect", f"unixsock-stream/{tmp_path}/no-router"]
    with subprocess.Popen(
        [*options, "--public-url", url], stdout=subprocess.PIPE, text=True
    ) as process:
        try:
            assert process.stdout is not None
            assert process.stdout.readline().startswith(f"bpn dashboard: {url}/#token=")
            assert json.loads((tmp_path / ADDRESS_FILE).read_bytes())["url"] == url

            def answers() -> bool:
                with contextlib.suppress(httpx.TransportError):
                    found = httpx.get(f"http://127.0.0.1:{port}/healthz", headers={"Host": url[8:]})
                    return found.status_code == 200
                return False

            wait_for(answers, "an answer to the public name", DEADLINE_S)
        finally:
            process.kill()


def test_it_refuses_to_listen_beyond_loopback(tmp_path) -> None:
    refused = subprocess.run(
        [sys.executable, "-m", "bpn_dashboard", "--runs-dir", str(tmp_path), "--host", "0.0.0.0"],
        capture_output=True, text=True, timeout=DEADLINE_S, check=False, env=os.environ,
    )  # fmt: skip
    assert refused.returncode == 2
    assert "--insecure-http" in refused.stderr


def test_it_is_ready_while_workers_can_be_given_work(
    tmp_path, wait_for, free_tcp_endpoint, running_router
) -> None:
    with dashboard(tmp_path, wait_for, "--connect", free_tcp_endpoint) as (_, client, _link):

        def obstacle() -> str:
            answer = client.get("/readyz")
            return "" if answer.status_code == 200 else answer.json()["detail"]

        assert "not reached yet" in obstacle()
        with running_router(free_tcp_endpoint):
            wait_for(lambda: not obstacle(), "the dashboard to be ready", DEADLINE_S)
        lost = f"the connection to the router at {free_tcp_endpoint} is lost: nobody listens"
        wait_for(lambda: lost in obstacle(), "the lost router to be told, and why", DEADLINE_S)
        assert client.get("/healthz").is_success  # its pages are served all the same


def test_over_tls_pages_commands_and_the_live_view_work_with_a_self_made_certificate(
    tmp_path, wait_for, capsys
) -> None:
    validity = Validity.of_days(1)
    authority = new_authority("own", validity)
    own = issue(authority, "dashboard", validity, server_names=["127.0.0.1"])
    certificate, key = tmp_path / "certificate.pem", tmp_path / "key.pem"
    certificate.write_bytes(own.certificate_pem())
    key.write_bytes(own.key_pem())
    options = ("--certificate", str(certificate), "--key", str(key))
    with dashboard(tmp_path, wait_for, *options) as (_, client, link):
        base = str(client.base_url).rstrip("/")
        assert base.startswith("https://127.0.0.1:")
        assert main(["runs", "ls", "--json", "--runs-dir", str(tmp_path)]) == 0
        assert json.loads(capsys.readouterr().out) == []
        with pytest.raises(httpx.ConnectError, match="CERTIFICATE_VERIFY_FAILED"):
            httpx.get(base)  # nobody vouches for it
        with pytest.raises(httpx.HTTPError):
            httpx.get(base.replace("https", "http"))

        trust = ssl.create_default_context(cadata=authority.certificate_pem().decode())
        browser = httpx.Client(base_url=base, verify=trust, headers={"Origin": base})
        with browser:
            answer = browser.post("/api/v1/session", json={"token": link})
            cookie = answer.headers["set-cookie"]
            assert cookie.startswith("__Host-bpn_session_")
            assert "Secure" in cookie
            assert browser.get("/").is_success
            assert browser.get("/api/v1/session").json()["role"] == "admin"
        with connect(
            base.replace("https", "wss") + "/api/v1/live",
            origin=base,
            ssl=trust,
            additional_headers={"Cookie": cookie.partition(";")[0]},
        ) as socket:
            with pytest.raises(ConnectionClosed):
                socket.recv(DEADLINE_S)
            assert socket.close_code == 4503  # logged in, and there is no bus


def refused(*options: str, environment: dict[str, str] | None = None) -> str:
    """What a dashboard says that ends at once for a wrong start."""
    done = subprocess.run(
        [sys.executable, "-m", "bpn_dashboard", "--port", "0", *options],
        capture_output=True, text=True, timeout=DEADLINE_S, check=False,
        env=os.environ | (environment or {}),
    )  # fmt: skip
    assert done.returncode == 2
    assert "Traceback" not in done.stderr
    (line,) = [line for line in done.stderr.splitlines() if " ERROR " in line]
    return line


def test_a_second_dashboard_of_a_state_folder_ends_and_names_the_first(tmp_path, wait_for) -> None:
    with dashboard(tmp_path, wait_for) as (process, client, _):
        line = refused("--runs-dir", str(tmp_path))
        assert f"in use by the dashboard at {str(client.base_url).rstrip('/')}" in line
        assert f"(pid {process.pid})" in line
        assert client.get("/healthz").is_success
        process.send_signal(signal.SIGKILL)  # which frees the folder
        process.wait(DEADLINE_S)
    with dashboard(tmp_path, wait_for):
        pass


@pytest.mark.parametrize("offset", [0, 4096])
def test_a_damaged_database_is_one_line_with_the_remedy(tmp_path, wait_for, offset: int) -> None:
    with dashboard(tmp_path, wait_for) as (process, _, _):
        process.terminate()
        assert process.wait(DEADLINE_S) == 0
    file = tmp_path / ".dashboard.sqlite"
    with file.open("r+b") as database:
        database.seek(offset)
        database.write(b"\x5a" * 4096)
    line = refused("--runs-dir", str(tmp_path))
    assert f"{file} is damaged" in line
    assert "delete the file" in line
    assert "reindex" in line


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--runs-dir", "/proc/none"], "No such file or directory: /proc/none"),
        (["--runs-dir", "FILE"], "File exists: FILE"),
        (["--state-dir", "/proc/none"], "No such file or directory: /proc/none"),
        (["--metrics-token", "/proc/none"], "/proc/none"),
        (["--connect", "router"], "'router' is no endpoint of a router: give tcp/HOST:PORT"),
        (["--connect", "tcp/127.0.0.1:70000"], "port 70000 is above 65535"),
    ],
)
def test_what_cannot_be_used_is_one_line_that_names_it(tmp_path, options, said: str) -> None:
    (tmp_path / "file").touch()
    file = str(tmp_path / "file")
    given = {"--runs-dir": str(tmp_path / "runs")} | {options[0]: options[1].replace("FILE", file)}
    line = refused(*(part for option in given.items() for part in option))
    assert said.replace("FILE", file) in line


def test_a_router_that_needs_certificates_is_refused_at_once_without_them(tmp_path) -> None:
    options = ("--runs-dir", str(tmp_path), "--connect", "tls/127.0.0.1:7999")
    assert "needs certificates" in refused(*options, environment={"BPN_CERTIFICATES": ""})


def test_a_second_dashboard_on_a_router_never_takes_a_run_not_even_in_its_first_moment(
    tmp_path, wait_for, endpoint: str
) -> None:
    run, runs = {"config": {"task": "reaching"}}, tmp_path / "two"
    with dashboard(tmp_path / "one", wait_for, "--connect", endpoint) as (first, one, _):
        wait_for(lambda: one.get("/readyz").is_success, "the first to serve", DEADLINE_S)
        folder = RunFolder.create(
            runs, UUID("01a201f9-821b-74c6-95eb-3f4ab1331c4c"), RunConfig.for_task("reaching")
        )
        folder.write("about.json", b'{"desired_state": "running"}')
        sentence = f"pid {first.pid}) serves this router: read-only"
        with dashboard(runs, wait_for, "--connect", endpoint) as (_, two, _):
            for _ in range(40):
                answer = two.post("/api/v1/runs", json=run)
                assert answer.status_code == 409
                assert sentence in answer.json()["detail"]
            assert two.get("/api/v1/runs").json()["total"] == 1

            def waits_for() -> str:
                return two.get(f"/api/v1/runs/{folder.run}").json()["waiting_reason"]

            wait_for(lambda: sentence in waits_for(), "the reason at its own run", DEADLINE_S)


def test_of_two_dashboards_on_a_router_the_second_is_read_only_until_the_first_is_gone(
    tmp_path, wait_for, endpoint: str
) -> None:
    run = {"config": {"task": "reaching"}}

    def ready(client: httpx.Client) -> str:
        answer = client.get("/readyz")
        return "" if answer.is_success else str(answer.json()["detail"])

    with dashboard(tmp_path / "one", wait_for, "--connect", endpoint) as (first, one, _):
        wait_for(lambda: not ready(one), "the first to serve", DEADLINE_S)
        with dashboard(tmp_path / "two", wait_for, "--connect", endpoint) as (_, two, _):
            sentence = f"pid {first.pid}) serves this router: read-only"
            wait_for(lambda: sentence in ready(two), "the second to see the first", DEADLINE_S)
            answer = two.post("/api/v1/runs", json=run)
            assert answer.status_code == 409
            assert sentence in answer.json()["detail"]
            assert sentence in two.get("/api/v1/system/status").json()["read_only"]
            assert two.get("/api/v1/runs").json()["total"] == 0
            assert one.post("/api/v1/runs", json=run).status_code == 201
            first.send_signal(signal.SIGKILL)
            wait_for(lambda: not ready(two), "the second to take over", DEADLINE_S)
            assert two.post("/api/v1/runs", json=run).status_code == 201
