"""One `bpn up` with a pool of workers for the whole session, and a Chromium that reports everything."""

import re
import shutil
import subprocess
import threading
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

DEADLINE_MS = 20_000
START_DEADLINE_S = 60.0
LOOPBACK = ("127.0.0.1", "localhost", "[::1]")

expect.set_options(timeout=DEADLINE_MS)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    if shutil.which("chromium") is None:
        skip = pytest.mark.skip(reason="no chromium; `make test-browser` says how to get it")
        for item in items:
            if item.path.parent == Path(__file__).parent:
                item.add_marker(skip)


@dataclass
class Dashboard:
    """A running `bpn up`.

    Attributes:
        url: where its pages are, with a trailing slash.
        token: opens an operator's session.
    """

    process: subprocess.Popen[str]
    runs_dir: Path
    url: str = ""
    token: str = ""
    lines: list[str] = field(default_factory=list)

    @property
    def sign_in_url(self) -> str:
        return f"{self.url}#token={self.token}"

    def server(self) -> psutil.Process:
        """The process of the dashboard itself."""
        for child in psutil.Process(self.process.pid).children(recursive=True):
            if "bpn_dashboard" in " ".join(child.cmdline()):
                return child
        raise LookupError("`bpn up` has no dashboard process")


@pytest.fixture(scope="session")
def dashboard(
    tmp_path_factory: pytest.TempPathFactory, command: Callable[..., list[str]]
) -> Iterator[Dashboard]:
    """Router, dashboard, two learners and two robots with their edges; its registry holds one tiny run."""
    runs_dir = tmp_path_factory.mktemp("runs")
    arguments = ["up", "--port", "0", "--learners", "2", "--robots", "2", "--edges", "2"]
    process = subprocess.Popen(
        command(*arguments, "--empty", "--runs-dir", str(runs_dir)),
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    dashboard = Dashboard(process, runs_dir)
    ready = threading.Event()

    def read() -> None:
        assert process.stdout is not None
        for line in process.stdout:
            dashboard.lines.append(line)
            if found := re.search(r"(http://\S+?/)#token=(\S+)", line):
                dashboard.url, dashboard.token = found.groups()
                ready.set()

    threading.Thread(target=read, name="output of bpn up", daemon=True).start()
    try:
        if not ready.wait(START_DEADLINE_S):
            pytest.fail(f"bpn up printed no URL in {START_DEADLINE_S:.0f} s: {dashboard.lines}")
        yield dashboard
    finally:
        process.terminate()
        process.wait(15)


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
    allowed: list[str] = field(default_factory=list)

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
            **{"viewport": {"width": 1280, "height": 900}, "accept_downloads": True, **options}
        )
        context.set_default_timeout(DEADLINE_MS)
        context.add_init_script(REPORT_VIOLATIONS)
        context.route(leaves_loopback, lambda route: route.abort())
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
def page(open_context: Callable[..., BrowserContext], dashboard: Dashboard) -> Page:
    """A page of a signed-in operator."""
    page = open_context(reduced_motion="reduce").new_page()
    page.goto(dashboard.sign_in_url)
    expect(page.get_by_role("heading", level=1)).to_be_visible()
    return page
