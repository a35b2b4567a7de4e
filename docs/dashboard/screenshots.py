"""The pictures of the web UI in docs/dashboard, and how long a newcomer waits for them.

Starts `bpn up` in an empty runs folder, opens the link that it prints, and fails unless a learning curve is drawn
and a camera moves within a minute. Then a sweep, long enough that its curves say something. About ten
minutes on two cores:

    make screenshots
"""

import io
import json
import queue
import re
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from PIL import Image
from playwright.sync_api import Page, ViewportSize, expect, sync_playwright

PICTURES = Path(__file__).resolve().parent
NEWCOMER_S = 60.0
DEADLINE_S, SWEEP_DEADLINE_S = 300.0, 1200.0
SIZE_PX: ViewportSize = {"width": 1280, "height": 800}
THEMES: tuple[Literal["light"], Literal["dark"]] = ("light", "dark")
COLOURS = 160
SWEEP = {
    "name": "alpha by hidden units",
    "config": {"task": "reaching", "iterations": 8, "episodes": 5, "epochs": 4},
    "grid": {"alpha": [0.5, 0.8, 0.95], "hidden_units": [32, 128]},
    "seeds": [0, 1],
}


def main() -> None:
    """Takes every picture, in both themes."""
    PICTURES.mkdir(exist_ok=True)
    with (
        tempfile.TemporaryDirectory(prefix="bpn-screenshots-") as runs_dir,
        bpn_up(Path(runs_dir)) as (link, started_s),
        sync_playwright() as playwright,
    ):
        chromium = playwright.chromium.launch(
            executable_path=shutil.which("chromium"), args=["--no-sandbox"]
        )
        page = chromium.new_page(viewport=SIZE_PX, reduced_motion="reduce")
        page.set_default_timeout(DEADLINE_S * 1000)
        expect.set_options(timeout=DEADLINE_S * 1000)
        page.goto(link)
        visit = Visit(page, link.partition("#")[0], Path(runs_dir))
        newcomer(visit, started_s)
        pictures_of_a_run(visit)
        pictures_of_many(visit)
        first_comparison(visit)
        chromium.close()


@contextmanager
def bpn_up(runs_dir: Path) -> Iterator[tuple[str, float]]:
    """Gives the link that it prints, and when it was started."""
    started_s = time.monotonic()
    command = [sys.executable, "-m", "bpn", "up", "--port", "0", "--runs-dir", str(runs_dir)]
    command += ["--first-run", "reaching"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)  # noqa: S603
    links: queue.Queue[str] = queue.Queue()
    threading.Thread(target=read_link, args=(process, links), daemon=True).start()
    try:
        yield links.get(timeout=DEADLINE_S), started_s
    finally:
        process.terminate()
        process.wait(60)


def read_link(process: "subprocess.Popen[str]", links: "queue.Queue[str]") -> None:
    assert process.stdout is not None
    for line in process.stdout:
        if found := re.search(r"http://\S+#token=\S+", line):
            links.put(found[0])


@dataclass
class Visit:
    """A signed-in browser page, and the dashboard behind it."""

    page: Page
    url: str
    runs_dir: Path

    def open(self, query: str) -> None:
        self.page.goto(self.url + query)

    def ask(self, method: str, path: str, body: Any = None) -> Any:
        """Calls the REST interface."""
        token = json.loads((self.runs_dir / ".dashboard.json").read_bytes())["token"]
        answer = self.page.request.fetch(
            f"{self.url}api/v1{path}",
            method=method,
            data=body,
            headers={"Authorization": f"Bearer {token}", "X-Requested-With": "screenshots"},
        )
        if not answer.ok:
            raise SystemExit(f"{method} {path}: {answer.status} {answer.text()}")
        return answer.json()

    def take(self, name: str) -> None:
        """The page as it is, in both themes."""
        for theme in THEMES:
            self.page.emulate_media(color_scheme=theme)
            self.page.wait_for_function(
                "theme => document.documentElement.dataset.theme === theme", arg=theme
            )
            self.charts_are_drawn()
            path = PICTURES / f"{name}-{theme}.png"
            picture = Image.open(io.BytesIO(self.page.screenshot())).convert("RGB")
            small = picture.quantize(COLOURS, dither=Image.Dither.NONE)
            small.save(path, optimize=True)
            print(f"{path.relative_to(PICTURES.parents[1])}: {path.stat().st_size / 1024:.0f} KiB")
        self.page.emulate_media(color_scheme="light")

    def charts_are_drawn(self) -> None:
        """Those in sight, with the newest points."""
        self.page.wait_for_function(
            """() => [...document.querySelectorAll('figure[data-ready]')].every((figure) =>
                 figure.getBoundingClientRect().top > innerHeight || figure.dataset.ready === 'true')"""
        )

    def wait(self, condition: Callable[[], bool], what: str, timeout_s: float = DEADLINE_S) -> None:
        deadline_s = time.monotonic() + timeout_s
        while not condition():
            if time.monotonic() > deadline_s:
                raise SystemExit(f"waited {timeout_s:.0f} s for {what}")
            self.page.wait_for_timeout(250)


def newcomer(visit: Visit, started_s: float) -> None:
    """From `bpn up` to a run's page that shows how it learns, and to its moving camera.

    Raises:
        SystemExit: it took longer than a minute.
    """
    page = visit.page
    page.get_by_role("link", name="first run").click()
    curve = page.get_by_role("application", name=re.compile("^Return"))
    expect(curve).to_be_visible()
    visit.charts_are_drawn()
    seconds = {"learning curve": time.monotonic() - started_s}
    page.get_by_role("link", name="Live", exact=True).click()
    page.wait_for_function("() => (window.__dash.stats()['frames drawn'] ?? 0) >= 10")
    seconds["moving camera"] = time.monotonic() - started_s
    for what, took_s in seconds.items():
        print(f"bpn up to a {what}: {took_s:.1f} s")
    if max(seconds.values()) > NEWCOMER_S:
        raise SystemExit(f"a newcomer should not wait longer than {NEWCOMER_S:.0f} s")


def pictures_of_a_run(visit: Visit) -> None:
    """The first run: its camera, its curves, its episodes; the services behind it."""
    page = visit.page
    expect(page.get_by_role("row", name=re.compile("chosen"))).to_be_visible()
    visit.take("live")
    run = visit.ask("GET", "/runs")["items"][0]["id"]
    iterations = 15
    visit.wait(
        lambda: visit.ask("GET", f"/runs/{run}")["iteration"] >= iterations,
        f"{iterations} iterations of the first run",
    )
    visit.open(f"?page=run&run={run}")
    expect(page.get_by_role("application", name=re.compile("^Return"))).to_be_visible()
    visit.take("run")
    visit.open("?page=system")
    expect(page.get_by_role("row", name=re.compile("camera → action"))).to_be_visible()
    visit.take("system")
    visit.open(f"?page=run&run={run}&tab=episodes&iteration=10&episode=3&t=9")
    expect(page.get_by_role("img", name="Frame 9, newest frame")).to_be_visible()
    visit.take("episodes")
    visit.ask("POST", f"/runs/{run}/stop")


def pictures_of_many(visit: Visit) -> None:
    """A sweep: the table of runs while it goes on; curves and heat map of its end; a new run's form."""
    page = visit.page
    sweep = visit.ask("POST", "/sweeps", SWEEP)["id"]

    def states() -> dict[str, int]:
        found: dict[str, int] = visit.ask("GET", f"/sweeps/{sweep}")["states"]
        return found

    visit.wait(
        lambda: states().get("finished", 0) >= 5, "the first runs of the sweep", SWEEP_DEADLINE_S
    )
    visit.open("?page=runs&columns=name,state,seed,config.alpha,config.hidden_units,"
               "iteration,return_last,return_best,updated")  # fmt: skip
    expect(page.get_by_role("region", name="Runs").get_by_role("rowheader")).to_have_count(13)
    start = page.get_by_role("button", name="Start run")
    expect(start).to_be_enabled()  # who is signed in is known
    visit.take("runs")
    start.click()
    expect(page.get_by_role("dialog", name="Start a run")).to_be_visible()
    visit.take("start")
    visit.wait(lambda: set(states()) == {"finished"}, "the end of the sweep", SWEEP_DEADLINE_S)
    visit.open(f"?page=compare&sweep_id={sweep}")
    expect(page.get_by_role("application", name=re.compile("^Return"))).to_be_visible()
    visit.take("compare")
    visit.open(f"?page=compare&sweep_id={sweep}&tab=heatmap&hx=alpha&hy=hidden_units")
    expect(page.get_by_role("region", name="Heat map")).to_be_visible()
    visit.take("heatmap")


def first_comparison(visit: Visit) -> None:
    """From the first page to a conclusion of six runs, two values by three seeds, without typing."""
    page = visit.page
    visit.open("?page=runs")
    started_s = time.monotonic()
    page.get_by_role("link", name="Compare", exact=True).click()
    page.get_by_role("button", name="Start a small comparison").click()
    page.get_by_role("button", name="Start 6 runs").click()
    conclusion = page.get_by_role("status").filter(has_text="alpha=0.95")
    expect(conclusion).to_contain_text("3 seeds each")
    print(f"first page to a conclusion of 2 x 3 runs: {time.monotonic() - started_s:.1f} s")
    expect(page.get_by_role("main")).to_contain_text(re.compile(r"6\s*finished"))
    for message in page.get_by_role("button", name="Dismiss").all():
        message.click()
    visit.take("results")


if __name__ == "__main__":
    main()
