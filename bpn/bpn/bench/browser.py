"""The browser's part of `bpn bench dashboard`: what somebody waits for in Chromium, without a window.

All times are taken inside of the page. That of opening a page begins with the request for its address, in a
browser that has its scripts already, and ends with the first frame that shows what was asked for.
"""

import contextlib
import shutil
from collections.abc import Iterator
from typing import Any
from urllib.parse import urlencode

from playwright.sync_api import CDPSession, Page, ViewportSize, sync_playwright

from bpn.bench.figures import Figure, results
from bpn.bench.rest import METRIC, TASK, medians
from bpn.bench.served import Served
from bpn.bench.sizes import Sizes
from bpn_shared.spec.config import ConfigError

COMPARE = (
    Figure("first_paint_ms", "compared in Chromium, first view, drawn, ms", 500.0),
    Figure("first_paint_again_ms", "  the same view again, drawn, ms", 500.0),
    Figure("zoom_paint_ms", "  zoom to another range, drawn, ms", 200.0),
    Figure("hover_fps", "  frames a second under a moving pointer", 55.0, "least"),
    Figure("compare_heap_mb", "  memory of the page's scripts, MB", 150.0),
)
TABLE = (
    Figure("table_open_ms", "table of runs in Chromium, opened, ms", 1000.0),
    Figure("table_search_ms", "  after a key in the search field, ms", 300.0),
    Figure("table_sort_ms", "  after a press on a heading, ms", 300.0),
    Figure("table_scroll_fps", "  frames a second while scrolling", 50.0, "least"),
    Figure("table_end_ms", "  from the first row to the last, ms"),
    Figure("table_rows_in_page", "  rows that are in the page", 200.0, digits=0),
)
_SIZE_PX: ViewportSize = {"width": 1280, "height": 800}
_DEADLINE_MS = 60_000
_HOVER_S, _SCROLL_S = 2.0, 3.0
_SCROLL_PX = 60

_SCRIPT = """
(() => {
  const drawn = () => new Promise((done) =>
    requestAnimationFrame(() => { const port = new MessageChannel();
      port.port1.onmessage = () => done(performance.now()); port.port2.postMessage(0); }));
  const until = async (condition) => {
    const begin = performance.now();
    while (!condition()) {
      if (performance.now() - begin > DEADLINE_MS) throw new Error(`waited in vain for ${condition}`);
      await new Promise(requestAnimationFrame);
    }
    return drawn();
  };
  const answered = (path) => performance.getEntriesByType('resource')
    .filter((entry) => entry.name.includes(path) && entry.responseEnd > 0).length;
  const changed = async (path, act, ready) => {
    performance.clearResourceTimings();
    const start = performance.now();
    act();
    return await until(() => answered(path) > 0 && ready()) - start;
  };
  const framesPerSecond = async (seconds, act) => {
    const start = performance.now();
    let frames = 0;
    while (performance.now() - start < 1000 * seconds) {
      act(frames);
      await new Promise(requestAnimationFrame);
      frames += 1;
    }
    return 1000 * frames / (performance.now() - start);
  };
  const chart = () => document.querySelector('figure[data-ready="true"] .u-over');
  const table = () => document.querySelector('[data-ready="true"] [role="region"]');
  const rows = () => [...document.querySelectorAll('[role="region"] tbody tr[aria-rowindex]')];
  window.__bench = { until, changed, framesPerSecond, chart, table, rows };
})();
""".replace("DEADLINE_MS", str(_DEADLINE_MS))


def measure_compare(served: Served, sizes: Sizes) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """Figures of `COMPARE`, on the runs that `rest.make_series` made."""
    with _page(served) as (page, chromium):
        # Each pair is a view that the server has not computed yet.
        kinds = [(s, b) for b in ("ci95", "std", "sem") for s in ("mean", "median", "iqm")]
        views = [
            _address(page="compare", task=TASK, metrics=METRIC, stat=s, band=b) for s, b in kinds
        ]
        page.goto(served.url + _address(page="compare", task=TASK, metrics="loss"))

        def open_ms(view: str) -> float:
            return _open_ms(page, served.url + view, "__bench.chart()")

        samples = {
            "first_paint_ms": [open_ms(view) for view in views[: sizes.repeats]],
            "first_paint_again_ms": [open_ms(views[0]) for _ in range(sizes.repeats)],
            "zoom_paint_ms": [_zoom_ms(page, place) for place in range(sizes.repeats)],
            "hover_fps": [_hover_fps(page)],
            "compare_heap_mb": [_heap_mb(chromium)],
        }
    return results(COMPARE, medians(samples)), samples


def measure_table(served: Served, sizes: Sizes) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """Figures of `TABLE`, on the runs that `rest.make_lists` made."""
    with _page(served) as (page, _):
        runs = served.url + _address(page="runs")
        page.goto(runs)
        samples = {
            "table_open_ms": [
                _open_ms(page, runs, "__bench.table()") for _ in range(sizes.repeats)
            ],
            "table_search_ms": [_search_ms(page, at) for at in range(sizes.repeats)],
        }
        _open_ms(page, runs, "__bench.table()")
        headings = ("Best return", "Return", "Seed", "State")
        samples["table_sort_ms"] = [
            _sort_ms(page, headings[at % len(headings)]) for at in range(sizes.repeats)
        ]
        samples["table_scroll_fps"] = [_scroll_fps(page)]
        samples["table_rows_in_page"] = [page.evaluate("__bench.rows().length")]
        samples["table_end_ms"] = [_end_ms(page)]
    return results(TABLE, medians(samples)), samples


@contextlib.contextmanager
def _page(served: Served) -> Iterator[tuple[Page, CDPSession]]:
    """A page of a browser that is logged in.

    Raises:
        ConfigError: there is no Chromium.
    """
    executable = shutil.which("chromium") or shutil.which("google-chrome")
    if executable is None:
        raise ConfigError("--parts browser needs Chromium: install the system's package `chromium`")
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=executable, args=["--no-sandbox"])
        page = chromium.new_page(viewport=_SIZE_PX)
        page.set_default_timeout(_DEADLINE_MS)
        page.add_init_script(_SCRIPT)
        page.goto(served.link())
        page.get_by_role("heading", name="Runs", exact=True).wait_for()
        yield page, page.context.new_cdp_session(page)
        chromium.close()


def _address(**query: str) -> str:
    return f"/?{urlencode(query)}"


def _open_ms(page: Page, url: str, shown: str) -> float:
    page.goto(url, wait_until="commit")
    return float(page.evaluate(f"__bench.until(() => {shown})"))


def _zoom_ms(page: Page, place: int) -> float:
    """Half the range around a place where no one has zoomed before, from all of it."""
    press = """(keys) => { const chart = document.querySelector('[role="application"]');
      for (const key of keys) chart.dispatchEvent(new KeyboardEvent('keydown', {key, bubbles: true})); }"""
    if place:
        page.evaluate(f"__bench.changed('series/query', () => ({press})(['0']), __bench.chart)")
    steps = ["Home", *["ArrowRight"] * (20 + 40 * place)]
    page.evaluate(f"({press})", steps)
    zoom = f"__bench.changed('series/query', () => ({press})(['+']), __bench.chart)"
    return round(float(page.evaluate(zoom)), 1)


def _hover_fps(page: Page) -> float:
    move = """(frame) => { const over = __bench.chart(), box = over.getBoundingClientRect();
      const clientX = box.left + (frame * 7) % box.width, clientY = box.top + box.height / 2;
      over.dispatchEvent(new MouseEvent('mousemove', {clientX, clientY, bubbles: true})); }"""
    return float(page.evaluate(f"__bench.framesPerSecond({_HOVER_S}, {move})"))


def _heap_mb(chromium: CDPSession) -> float:
    chromium.send("HeapProfiler.collectGarbage")
    chromium.send("Performance.enable")
    metrics = chromium.send("Performance.getMetrics")["metrics"]
    return float(next(m["value"] for m in metrics if m["name"] == "JSHeapUsedSize")) / 1e6


def _search_ms(page: Page, number: int) -> float:
    """A last key of "seed 1", "seed 2" ..."""
    write = f"""() => {{ const field = document.querySelector('input[type="search"]');
      field.focus(); field.value = 'seed {number}';
      field.dispatchEvent(new InputEvent('input', {{bubbles: true}})); }}"""
    shown = f"""() => __bench.table() && __bench.rows().length > 0 &&
      __bench.rows().every((row) => row.textContent.includes('seed {number}'))"""
    return float(page.evaluate(f"__bench.changed('api/v1/runs?', {write}, {shown})"))


def _sort_ms(page: Page, heading: str) -> float:
    press = f"""() => [...document.querySelectorAll('thead button')]
      .find((button) => button.textContent.trim() === '{heading}').click()"""
    return float(page.evaluate(f"__bench.changed('api/v1/runs?', {press}, __bench.table)"))


def _scroll_fps(page: Page) -> float:
    scroll = f"() => (__bench.table() ?? document.querySelector('[role=region]')).scrollBy(0, {_SCROLL_PX})"
    return float(page.evaluate(f"__bench.framesPerSecond({_SCROLL_S}, {scroll})"))


def _end_ms(page: Page) -> float:
    """The last row is the table's, and not a place that is kept for it."""
    to_end = """const region = document.querySelector('[role="region"]');
      region.scrollTop = region.scrollHeight;"""
    shown = """() => __bench.rows().at(-1)?.getAttribute('aria-rowindex') ===
      document.querySelector('table').getAttribute('aria-rowcount')"""
    wait = f"const start = performance.now(); {to_end} return await __bench.until({shown}) - start;"
    return float(page.evaluate(f"async () => {{ {wait} }}"))
