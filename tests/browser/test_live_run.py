"""What moves while a run learns: cameras, preferences, curves, services, the server."""

import re
from typing import Any

from playwright.sync_api import Page, expect

STATS = "name => (window.__dash.stats()[name] ?? 0)"


def open_run(page: Page, dashboard: Any, run: str, tab: str = "curves") -> None:
    page.goto(f"{dashboard.url}?page=run&run={run}&tab={tab}")
    expect(page.get_by_role("heading", level=1)).to_be_visible()


def frames_pass(page: Page, count: int) -> None:
    page.wait_for_function(
        "([before, count]) => window.__dash.stats()['frames drawn'] >= before + count",
        arg=[page.evaluate(STATS, "frames drawn"), count],
    )


def test_the_camera_moves_and_the_preferences_are_told(
    page: Page, dashboard: Any, running: str
) -> None:
    open_run(page, dashboard, running, "live")
    robot = page.get_by_role("region", name="Robot 0")
    frames_pass(page, 10)
    chosen = robot.get_by_role("row", name=re.compile("chosen"))
    expect(chosen).to_be_visible()
    expect(chosen).to_contain_text("joint")
    expect(robot.get_by_text(re.compile(r"\d fps"))).to_be_visible()
    drawn = robot.get_by_role("img", name="Robot 0, newest frame").evaluate(
        "canvas => new Set(canvas.getContext('2d').getImageData(0, 0, 84, 84).data).size"
    )
    assert drawn > 2  # more than one gray and the opaque alpha


def test_a_hidden_camera_is_not_sent(page: Page, dashboard: Any, running: str) -> None:
    open_run(page, dashboard, running, "live")
    frames_pass(page, 3)
    page.get_by_role("link", name="Logs").click()
    expect(page.get_by_role("log")).to_be_visible()
    drawn = page.evaluate(STATS, "frames drawn")
    lines = page.get_by_role("log").get_by_role("listitem")
    expect(lines.filter(has_text="waiting for").first).to_be_visible()
    assert page.evaluate(STATS, "frames drawn") == drawn


def test_a_zoom_survives_new_points(page: Page, dashboard: Any, running: str) -> None:
    page.goto(f"{dashboard.url}?page=run&run={running}&range=0.5,1.5")
    figure = page.get_by_role("figure", name=re.compile("^Return"))
    expect(figure).to_have_attribute("data-ready", "true")
    progress = page.get_by_role("progressbar", name="Iteration")
    before = float(progress.get_attribute("value") or 0)
    page.wait_for_function(
        "([bar, before]) => bar.value > before + 1", arg=[progress.element_handle(), before]
    )
    expect(figure.get_by_title("Show all again (0)")).to_have_text(re.compile("0.5–1.5"))
    assert "range=0.5%2C1.5" in page.url or "range=0.5,1.5" in page.url
    figure.get_by_title("Show all again (0)").click()
    expect(figure.get_by_title("Show all again (0)")).to_have_count(0)
    assert "range" not in page.url


def test_values_of_a_curve_are_read_by_keyboard_and_as_a_table(
    page: Page, dashboard: Any, running: str
) -> None:
    open_run(page, dashboard, running)
    figure = page.get_by_role("figure", name=re.compile("^Return"))
    figure.get_by_role("application").focus()
    page.keyboard.press("Home")
    expect(figure.get_by_text(re.compile(r"^iteration 0: Return [−-]"))).to_be_attached()
    figure.get_by_role("button", name="Return as a table").click()
    expect(figure.get_by_role("table").get_by_role("row").nth(1)).to_contain_text("px")


def test_the_system_page_says_who_is_alive_and_what_flows(
    page: Page, dashboard: Any, running: str
) -> None:
    page.goto(f"{dashboard.url}?page=system")
    services = page.get_by_role("region", name="Services")
    for name in ("Learner", "Edge 0", "Robot 0"):
        row = services.get_by_role("row", name=re.compile(f"^{name} live {running[-8:]}"))
        expect(row).to_be_visible()
        expect(row).to_contain_text("MiB")
    expect(services.get_by_role("row", name=re.compile("^Edge live idle"))).to_be_visible()
    latencies = page.get_by_role("region", name="Latencies")
    for hop in ("camera → edge", "edge → robot", "camera → action", "weights, published → loaded"):
        expect(latencies.get_by_role("row", name=re.compile(hop)).first).to_contain_text("s")
    flows = page.get_by_role("region", name="Flows")
    expect(flows.get_by_role("row", name=re.compile("^frame Robot 0 Edge 0"))).to_be_visible()
    expect(page.get_by_role("img", name=re.compile("^Robots send frames"))).to_be_visible()


def test_the_server_goes_away_and_comes_back(
    page: Page, dashboard: Any, running: str, watch: Any, wait_for: Any
) -> None:
    watch.allow(
        "ERR_CONNECTION_REFUSED|WebSocket connection|ERR_EMPTY_RESPONSE|ERR_CONNECTION_RESET"
    )
    open_run(page, dashboard, running)
    progress = page.get_by_role("progressbar", name="Iteration")
    expect(progress).not_to_have_attribute("value", "0")
    before = int(progress.get_attribute("value") or 0)

    killed = dashboard.server()
    killed.kill()
    wait_for(lambda: dashboard.is_served_by_another(killed), "the dashboard to be started again")
    successor = dashboard.server()
    successor.suspend()  # or it may be back before anybody is told
    try:
        expect(page.get_by_role("status").filter(has_text="offline")).to_be_visible()
        banner = page.get_by_role("alert").filter(has_text="Robots and learners go on without it")
        expect(banner).to_be_visible()
        expect(
            page.get_by_role("heading", name="long run", level=1)
        ).to_be_visible()  # nothing is lost
    finally:
        successor.resume()

    expect(page.get_by_role("status").filter(has_text="live")).to_be_visible()
    expect(banner).to_be_hidden()
    page.wait_for_function(
        "([bar, before]) => bar.value > before", arg=[progress.element_handle(), before]
    )
    # The run went on meanwhile, and its curve has every iteration.
    answer = dashboard.ask("GET", f"/runs/{running}")
    query = {
        "runs": [running],
        "group_by": None,
        "metrics": ["return_px"],
        "x": "iteration",
        "range": None,
        "max_points": 4000,
        "statistic": "mean",
        "band": "std",
    }
    x = dashboard.ask("POST", "/series/query", query)["series"][0]["x"]
    assert x == list(range(len(x)))
    assert len(x) >= answer["iteration"] - 1
    assert answer["attempt"] == 1
