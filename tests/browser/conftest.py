"""One `bpn up` with a pool of workers for the whole session, and a Chromium that reports everything."""

import contextlib
import json
import queue
import re
import shutil
import subprocess
import threading
import urllib.request
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import psutil
import pytest
from playwright.sync_api import (
    Browser,
    BrowserContext,
    ConsoleMessage,
    Page,
    Request,
    expect,
    sync_playwright,
)

DEADLINE_MS = 60_000
"""Long, because only what is broken waits so long, on a machine that may be busy."""
START_DEADLINE_S = 240.0
TEST_DEADLINE_S = 600.0
TINY = {
    "task": "reaching",
    "iterations": 3,
    "episodes": 4,
    "steps": 8,
    "epochs": 2,
    "hidden_units": 24,
}
LOOPBACK = ("127.0.0.1", "localhost", "::1")

expect.set_options(timeout=DEADLINE_MS)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    no_chromium = pytest.mark.skipif(
        shutil.which("chromium") is None,
        reason="no chromium; `make test-browser` installs it or says how",
    )
    for item in items:
        if item.path.parent == Path(__file__).parent:
            item.add_marker(no_chromium)
            item.add_marker(pytest.mark.timeout(TEST_DEADLINE_S))


@dataclass
class Dashboard:
    """A running `bpn up`.

    Attributes:
        link: what it printed: opens a session once.
    """

    process: subprocess.Popen[str]
    runs_dir: Path
    link: str

    @property
    def url(self) -> str:
        return self.link.partition("#")[0]

    @property
    def token(self) -> str:
        """An operator's, which can be used again and again; another one after a restart."""
        token: str = json.loads((self.runs_dir / ".dashboard.json").read_bytes())["token"]
        return token

    def new_link(self) -> str:
        """Opens a session once, like the one that was printed."""
        return f"{self.url}#token={self.ask('POST', '/links', {'role': 'operator'})['token']}"

    def ask(
        self, method: str, path: str, body: object = None, headers: dict[str, str] | None = None
    ) -> Any:
        """Calls the REST interface as a script would."""
        request = urllib.request.Request(
            f"{self.url}api/v1{path}",
            method=method,
            data=None if body is None else json.dumps(body).encode(),
            headers={
                "Authorization": f"Bearer {self.token}",
                "Content-Type": "application/json",
                "X-Requested-With": "test",
                **(headers or {}),
            },
        )
        with urllib.request.urlopen(request, timeout=30) as answer:
            return json.loads(answer.read() or b"null")

    def runs(self) -> list[dict[str, Any]]:
        items: list[dict[str, Any]] = self.ask("GET", "/runs")["items"]
        return items

    def has_runs(self) -> bool:
        """Whether it answers and knows a run."""
        try:
            return bool(self.runs())
        except OSError:
            return False

    def start(self, **changes: object) -> str:
        """Starts a tiny run of reaching by REST; returns its id."""
        about = {key: changes.pop(key) for key in ("name",) if key in changes}
        run: str = self.ask("POST", "/runs", {"config": {**TINY, **changes}, **about})["id"]
        return run

    def patch(self, run: str, rev: int, changes: dict[str, object]) -> None:
        self.ask("PATCH", f"/runs/{run}", changes, {"If-Match": f'"{rev}"'})

    def state(self, run: str) -> str:
        state: str = self.ask("GET", f"/runs/{run}")["state"]
        return state

    def is_served_by_another(self, than: psutil.Process) -> bool:
        """Whether the dashboard was started again."""
        try:
            return self.server() != than
        except LookupError:
            return False

    def server(self) -> psutil.Process:
        """The process of the dashboard itself."""
        for child in psutil.Process(self.process.pid).children(recursive=True):
            with contextlib.suppress(psutil.NoSuchProcess):  # one that ends just now
                if "bpn_dashboard" in child.cmdline():
                    return child
        raise LookupError("`bpn up` has no dashboard process")


Begin = Callable[..., contextlib.AbstractContextManager[Dashboard]]


@pytest.fixture(scope="session")
def begin_dashboard(
    tmp_path_factory: pytest.TempPathFactory,
    command: Callable[..., list[str]],
    wait_for: Callable[..., None],
) -> Begin:
    """Starts router, dashboard, a learner, a robot and two edges, one of them idle; the first run is stopped."""

    @contextlib.contextmanager
    def begin(environment: dict[str, str] | None = None) -> Iterator[Dashboard]:
        runs_dir = tmp_path_factory.mktemp("runs")
        arguments = ["up", "--port", "0", "--edges", "2", "--first-run", "reaching"]
        arguments += ["--runs-dir", str(runs_dir)]
        yield from _serving(command(*arguments), runs_dir, environment, wait_for)

    return begin


def _serving(
    command: list[str],
    runs_dir: Path,
    environment: dict[str, str] | None,
    wait_for: Callable[..., None],
) -> Iterator[Dashboard]:
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment)
    link: queue.Queue[str] = queue.Queue()
    threading.Thread(target=_find_link, args=(process, link), daemon=True).start()
    try:
        dashboard = Dashboard(process, runs_dir, link.get(timeout=START_DEADLINE_S))
        wait_for(dashboard.has_runs, "the first run", START_DEADLINE_S)
        for run in dashboard.runs():
            dashboard.ask("POST", f"/runs/{run['id']}/stop")
        yield dashboard
    finally:
        process.terminate()
        process.wait(60)


@pytest.fixture(scope="session")
def dashboard(begin_dashboard: Begin) -> Iterator[Dashboard]:
    """The one that most tests share."""
    with begin_dashboard() as running:
        yield running


def _find_link(process: subprocess.Popen[str], link: "queue.Queue[str]") -> None:
    assert process.stdout is not None
    for line in process.stdout:
        if found := re.search(r"http://\S+#token=\S+", line):
            link.put(found[0])


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    """Debian's Chromium; it resolves no name, so nothing can leave this machine."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=shutil.which("chromium"),
            args=["--no-sandbox", "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1"],
        )
        yield browser
        browser.close()


@dataclass
class Watch:
    """What a page must not do; a test that provokes an error allows it by its text."""

    console: list[str] = field(default_factory=list)
    outside: list[str] = field(default_factory=list)
    allowed: list[str] = field(default_factory=lambda: ["ERR_NETWORK_CHANGED"])  # of this machine

    def allow(self, pattern: str) -> None:
        """Console errors that match are part of the test."""
        self.allowed.append(pattern)

    def on_console(self, message: ConsoleMessage) -> None:
        if message.type in ("error", "warning"):
            self.console.append(f"{message.type}: {message.text} ({message.location.get('url')})")

    def on_request(self, request: Request) -> None:
        self.on_url(request.url)

    def on_url(self, url: str) -> None:
        if leaves_loopback(url):
            self.outside.append(url)

    def complaints(self) -> list[str]:
        unexpected = [
            text for text in self.console if not any(re.search(p, text) for p in self.allowed)
        ]
        return unexpected + [f"request to {url}" for url in self.outside]


def leaves_loopback(url: str) -> bool:
    parts = urlsplit(url)
    return parts.scheme in ("http", "https", "ws", "wss") and parts.hostname not in LOOPBACK


@pytest.fixture
def watch() -> Watch:
    return Watch()


# Violations of the content security policy become console errors with their directive.
REPORT_VIOLATIONS = """
document.addEventListener('securitypolicyviolation', (event) =>
  console.error(`CSP ${event.effectiveDirective}: ${event.blockedURI} ${event.sample}`))
"""


@pytest.fixture
def open_context(browser: Browser, watch: Watch) -> Iterator[Callable[..., BrowserContext]]:
    """Makes browser contexts (profiles) whose pages are all watched."""
    contexts: list[BrowserContext] = []

    def open_one(**options: Any) -> BrowserContext:
        context = browser.new_context(
            **{"viewport": {"width": 1280, "height": 900}, "reduced_motion": "reduce", **options}
        )
        context.set_default_timeout(DEADLINE_MS)
        context.add_init_script(REPORT_VIOLATIONS)
        context.on("request", watch.on_request)
        context.on("console", watch.on_console)
        context.on("weberror", lambda error: watch.console.append(f"uncaught: {error.error}"))
        context.on("page", lambda page: page.on("websocket", lambda ws: watch.on_url(ws.url)))
        contexts.append(context)
        return context

    yield open_one
    for context in contexts:
        context.close()
    assert watch.complaints() == []


@pytest.fixture
def sign_in(
    open_context: Callable[..., BrowserContext], dashboard: Dashboard
) -> Callable[..., Page]:
    """Opens a page of a signed-in operator, in a profile with these options."""

    def open_one(**options: Any) -> Page:
        page = open_context(**options).new_page()
        page.goto(dashboard.new_link())
        expect(page.get_by_role("heading", name="Runs", level=1)).to_be_visible()
        return page

    return open_one


@pytest.fixture
def page(sign_in: Callable[..., Page]) -> Page:
    """A page of a signed-in operator."""
    return sign_in()


@pytest.fixture(scope="session")
def finished(dashboard: Dashboard, wait_for: Callable[..., None]) -> str:
    """A tiny run that has finished."""
    run = dashboard.start(name="finished run")
    wait_for(lambda: dashboard.state(run) == "finished", "the run to finish", START_DEADLINE_S)
    return run


@pytest.fixture(scope="module")
def running(dashboard: Dashboard, wait_for: Callable[..., None]) -> Iterator[str]:
    """A run that goes on as long as this module's tests."""
    run = dashboard.start(name="long run", iterations=100_000, steps=20)
    wait_for(lambda: dashboard.state(run) == "running", "the run to begin", START_DEADLINE_S)
    yield run
    dashboard.ask("POST", f"/runs/{run}/stop")
