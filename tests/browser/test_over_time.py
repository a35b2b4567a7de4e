"""What one sees of the past: logs that grow, alerts, load, where attempts were made."""

import re
from typing import Any

from playwright.sync_api import Page, expect
from written_runs import make_run, say

AT_END = "log => log.scrollHeight - log.scrollTop - log.clientHeight < 24"
TRACEBACK = "it failed\nTraceback (most recent call last):\n" + "  File x\n" * 40 + "Error: no GPU"


def test_a_log_is_followed_until_its_reader_scrolls_away(
    page: Page, dashboard: Any, wait_for: Any
) -> None:
    folder = make_run(dashboard, wait_for)
    page.goto(f"{dashboard.url}?page=run&run={folder.run}&tab=logs")
    log = page.get_by_role("log", name="Log of the run")
    for i in range(300, 340, 4):  # in pieces, as services write
        say(folder, i, 4)
        expect(log.get_by_text(f"said {i + 3}", exact=True)).to_be_visible()
        page.wait_for_function(AT_END, arg=log.element_handle())
    log.hover()
    page.mouse.wheel(0, -600)
    back = page.get_by_role("button", name="To the end")
    expect(back).to_be_visible()
    say(folder, 340, 5)
    expect(page.get_by_role("button", name="5 new")).to_be_visible()
    page.get_by_role("button", name="5 new").click()
    expect(log.get_by_text("said 344", exact=True)).to_be_visible()
    page.wait_for_function(AT_END, arg=log.element_handle())


def test_the_first_line_of_a_long_log_is_found_and_a_traceback_has_its_lines(
    page: Page, dashboard: Any, wait_for: Any
) -> None:
    folder = make_run(dashboard, wait_for, error=TRACEBACK)
    with (folder.logs / "learner.log").open("a") as log_file:
        log_file.write(f"2026-11-28T10:00:00.000Z learner ERROR {TRACEBACK}\n")
    say(folder, 5000, 400, text="more")
    page.goto(f"{dashboard.url}?page=run&run={folder.run}&tab=logs&search=said+0")
    log = page.get_by_role("log", name="Log of the run")
    expect(log.get_by_text("said 0", exact=True)).to_be_visible()
    page.goto(f"{dashboard.url}?page=run&run={folder.run}&tab=logs&level=ERROR")
    expect(log.get_by_text("Error: no GPU", exact=True)).to_be_visible()
    rows = log.get_by_role("listitem").evaluate_all(
        "all => all.map((row) => row.getBoundingClientRect().top)"
    )
    assert len(rows) == len(set(rows)) > 10  # none is printed over another
    reason = page.get_by_role("alert").filter(has_text="Why it failed")
    expect(reason).to_contain_text("Error: no GPU")
    assert reason.bounding_box()["height"] < 120


def test_curves_show_pauses_holes_and_resumptions(
    page: Page, dashboard: Any, wait_for: Any
) -> None:
    folder = make_run(dashboard, wait_for)
    page.goto(f"{dashboard.url}?page=run&run={folder.run}&x=process_s")
    loss = page.get_by_role("figure", name=re.compile("^Loss"))
    expect(loss.get_by_text(re.compile("no value since time worked"))).to_be_visible()
    figure = page.get_by_role("figure", name=re.compile("^Return"))
    expect(figure).to_have_attribute("data-ready", "true")
    figure.get_by_role("application").focus()
    page.keyboard.press("End")
    expect(figure.get_by_text(re.compile(r"^time worked 1\smin 40\ss"))).to_be_attached()
    figure.get_by_role("button", name="Scale of Return").click()
    page.get_by_role("group", name="Scale of Return").get_by_label("Logarithmic").check()
    expect(figure.get_by_text("log on both sides of 0")).to_be_visible()
    assert "y.return_px=log" in page.url
    page.reload()
    expect(figure.get_by_text("log on both sides of 0")).to_be_visible()

    page.goto(f"{dashboard.url}?page=run&run={folder.run}&tab=config")
    environment = page.get_by_role("region", name="Environment")
    expect(environment).to_contain_text("machine-1")
    environment.get_by_label("Attempt").select_option("attempt 1")
    expect(environment).to_contain_text("machine-0")


def test_a_run_that_fails_is_told_and_load_is_kept(
    page: Page, dashboard: Any, wait_for: Any
) -> None:
    page.goto(f"{dashboard.url}?page=system")
    expect(page.get_by_role("heading", name="Load over time")).to_be_visible()
    make_run(dashboard, wait_for, error="somebody pulled the plug")
    text = "reaching bpn seed 0 failed: somebody pulled the plug"
    expect(page.get_by_role("region", name="Messages").get_by_text(text)).to_be_visible()
    expect(page.get_by_role("region", name="Alerts").get_by_role("listitem").first).to_contain_text(
        text
    )
    chart = page.get_by_role("figure", name=re.compile("^CPU"))
    expect(chart.get_by_text("Dashboard").first).to_be_visible()  # it may have been started again
    page.get_by_role("region", name="Messages").get_by_role("button", name="Show").click()
    expect(page.get_by_role("heading", name="reaching bpn seed 0", level=1)).to_be_visible()


def test_a_run_that_failed_at_once_says_so_and_offers_nothing_that_is_not_there(
    page: Page, dashboard: Any, wait_for: Any
) -> None:
    folder = make_run(dashboard, wait_for, attempts=1, each=0, error="torch finds no GPU")
    page.goto(f"{dashboard.url}?page=run&run={folder.run}")
    expect(page.get_by_text("The run failed before its first iteration was done")).to_be_visible()
    expect(page.get_by_role("figure")).to_have_count(0)
    page.get_by_role("link", name="Episodes").click()
    expect(page.get_by_text("The run ended before its first episode.")).to_be_visible()
    page.get_by_role("link", name="Live").click()
    expect(page.get_by_text("It ended before its first episode.")).to_be_visible()
    expect(page.get_by_role("link", name="Play stored episodes")).to_have_count(0)
    expect(page.get_by_role("main").get_by_role("button", name="Stop")).to_have_count(0)


def test_a_wrong_order_has_a_way_out_and_a_wrong_path_too(
    page: Page, dashboard: Any, watch: Any
) -> None:
    watch.allow("422")
    page.goto(f"{dashboard.url}?page=runs&sort=-nonsense")
    page.get_by_role("link", name="Without filters and order").click()
    expect(page.get_by_role("region", name="Runs")).to_be_visible()
    page.goto(f"{dashboard.url}runs/some-id")
    expect(page.get_by_role("heading", name="Runs", level=1)).to_be_visible()
    page.goto(f"{dashboard.url}old/bookmark")
    expect(page.get_by_text("There is no page “old”")).to_be_visible()


def test_a_page_whose_code_is_gone_is_read_anew_once(
    page: Page, dashboard: Any, watch: Any
) -> None:
    watch.allow("404|Failed to load")
    loads: list[object] = []
    page.on("load", lambda loaded: loads.append(loaded))  # noqa: PLW0108 - it is looked into
    page.goto(dashboard.url)
    expect(page.get_by_role("heading", level=1)).to_be_visible()
    loads.clear()
    page.route(re.compile(r"assets/Sweeps-.*\.js"), lambda route: route.fulfill(status=404))
    page.get_by_role("link", name="Sweeps").click()
    expect(page.get_by_text("The page’s code did not come")).to_be_visible()
    assert len(loads) == 1  # it was read anew, and not again when that did not help
    page.unroute(re.compile(r"assets/Sweeps-.*\.js"))
    page.get_by_role("button", name="Try again").click()
    expect(page.get_by_role("heading", name="Sweeps", level=1)).to_be_visible()
