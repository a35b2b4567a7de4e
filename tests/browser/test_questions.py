"""Which is better, start it again with changes, find those runs: by mouse, and by what is in the address."""

import re
from typing import Any

import pytest
from playwright.sync_api import Page, expect


def test_a_newcomer_compares_without_typing(page: Page, dashboard: Any) -> None:
    """From the first page to a sentence that says what two values of alpha came to."""
    page.get_by_role("navigation", name="Pages").get_by_role("link", name="Compare").click()
    page.get_by_role("button", name="Start a small comparison").click()
    dialog = page.get_by_role("dialog", name="Start a sweep")
    dialog.get_by_role("button", name="Start 6 runs").click()
    expect(page.get_by_role("heading", name="Compare", level=1)).to_be_visible()
    conclusion = page.get_by_role("status").filter(has_text="alpha=0.95")
    expect(conclusion).to_contain_text("3 seeds each", timeout=180_000)
    expect(conclusion).to_contain_text("run at least 4 of each")
    expect(page.get_by_role("main")).to_contain_text(re.compile(r"Compare\s*6 runs\s*6\s*finished"))
    groups = page.get_by_role("region", name="Groups")
    expect(groups.get_by_role("row")).to_have_count(3)
    groups.get_by_role("button", name="Baseline: alpha=0.95").click()
    expect(groups.get_by_role("button", name="Baseline: alpha=0.95")).to_have_attribute(
        "aria-pressed", "true"
    )
    figure = page.get_by_role("figure", name="A dot for each seed")
    expect(figure.locator("circle")).to_have_count(6)
    for kind, begins in {
        "SVG": b"<svg",
        "PDF": b"%PDF-1.4",
        "PNG": b"\x89PNG",
        "CSV": b"group",
    }.items():
        figure.get_by_role("button", name="Save A dot for each seed", exact=True).click()
        with page.expect_download() as download:
            figure.get_by_role("button", name=f"Save A dot for each seed as {kind}").click()
        assert download.value.path().read_bytes().startswith(begins), kind

    # A point that was never run is started from the heat map.
    sweep = dashboard.ask("GET", "/sweeps")["items"][0]["id"]
    other = dashboard.start(alpha=0.5, hidden_units=23, seed=9, iterations=1)
    page.goto(
        f"{dashboard.url}?page=compare&query=alpha%3D0.5,0.95&tab=heatmap&hx=alpha&hy=hidden_units"
    )
    page.get_by_role("button", name="Start runs at alpha 0.95, hidden_units 23").click()
    dialog = page.get_by_role("dialog", name="Start a sweep")
    expect(dialog.get_by_label("alpha", exact=True)).to_have_value("0.95")
    expect(dialog.get_by_label("hidden_units", exact=True)).to_have_value("23")
    dialog.get_by_role("button", name="Cancel").click()
    page.goto(f"{dashboard.url}?page=sweeps")
    page.get_by_role("button", name="Again").first.click()
    dialog = page.get_by_role("dialog", name="Start a sweep")
    expect(dialog.get_by_label("Values of alpha")).to_have_value("0.5, 0.95")
    expect(dialog.get_by_label("Seeds")).to_have_value("0, 1, 2")
    dialog.get_by_role("button", name="Cancel").click()
    for run in dashboard.ask("GET", f"/runs?sweep_id={sweep}")["items"] + [{"id": other}]:
        dashboard.ask("POST", f"/runs/{run['id']}/stop")


def test_a_curve_is_saved_as_it_stands(page: Page, dashboard: Any, finished: str) -> None:
    page.goto(f"{dashboard.url}?page=run&run={finished}")
    figure = page.get_by_role("figure", name=re.compile("^Loss"))
    figure.scroll_into_view_if_needed()
    expect(figure).to_have_attribute("data-ready", "true")
    for kind in ("SVG", "PDF"):
        figure.get_by_role("button", name="Save Loss", exact=True).click()
        with page.expect_download() as download:
            figure.get_by_role("button", name=f"Save Loss as {kind}").click()
        saved = download.value.path().read_bytes()
        assert b"Loss" in saved


def test_a_run_is_started_again_with_changes_and_continued(
    page: Page, dashboard: Any, finished: str, wait_for: Any
) -> None:
    page.goto(f"{dashboard.url}?page=run&run={finished}")
    page.get_by_role("button", name="Start again").click()
    dialog = page.get_by_role("dialog", name="Start a run")
    expect(dialog.get_by_label("Name")).to_have_value("finished run, again")
    expect(dialog.get_by_label("hidden_units", exact=True)).to_have_value("24")
    dialog.get_by_label("alpha", exact=True).fill("0.25")
    dialog.get_by_role("button", name="Start run").click()
    expect(page.get_by_role("heading", name="finished run, again", level=1)).to_be_visible()
    again = dashboard.runs()[0]
    assert (again["config"]["alpha"], again["config"]["iterations"]) == (0.25, 3)

    page.goto(f"{dashboard.url}?page=run&run={finished}")
    page.get_by_role("button", name="Continue from it").click()
    dialog = page.get_by_role("dialog", name="Start a run")
    expect(dialog.get_by_label("init_from", exact=True)).to_have_value(finished)
    dialog.get_by_role("button", name="Start run").click()
    expect(page.get_by_role("heading", name="finished run, continued", level=1)).to_be_visible()
    continued = dashboard.runs()[0]
    assert continued["config"]["init_from"].startswith(f"{finished}:3:")
    for run in (again, continued):
        wait_for(lambda run=run: dashboard.state(run["id"]) == "finished", "the run to finish", 120)


@pytest.mark.usefixtures("finished")
def test_runs_are_found_tagged_and_the_view_is_saved(
    page: Page, dashboard: Any, watch: Any
) -> None:
    watch.allow("422")
    search = page.get_by_role("searchbox", name="Search runs")
    search.fill("iteration>=3 and name:finished and statte:x")
    expect(page.get_by_role("alert").first).to_contain_text("did you mean state?")
    search.fill("iteration>=3 and name:finished")
    table = page.get_by_role("region", name="Runs")
    expect(page.get_by_role("alert")).to_have_count(0)
    expect(table.get_by_role("rowheader", name="finished run", exact=True)).to_be_visible()
    page.get_by_role("button", name="Columns").click()
    columns = page.get_by_role("group", name="Columns")
    columns.get_by_label("Metric").select_option("length")
    columns.get_by_role("button", name="Add").click()
    page.keyboard.press("Escape")
    page.get_by_role("button", name="Episode length, mean of last 5", exact=True).click()
    expect(
        table.get_by_role("columnheader", name="Episode length, mean of last 5")
    ).to_have_attribute("aria-sort", re.compile("ending"))
    table.get_by_role("checkbox", name="Select finished run", exact=True).check()
    toolbar = page.get_by_role("toolbar", name="Chosen runs")
    toolbar.get_by_role("button", name="Tag").click()
    toolbar.get_by_label("New tags").fill("paper, größe")
    toolbar.get_by_role("button", name="Change 1 run").click()
    expect(page.get_by_text("1 run changed")).to_be_visible()
    assert dashboard.ask("GET", "/runs?query=tag:paper")["items"][0]["tags"] == ["paper", "größe"]
    page.get_by_role("button", name="Views").click()
    page.get_by_label("Name of this view").fill("for the paper")
    page.get_by_role("group", name="Views").get_by_role("button", name="Save").click()
    shown = page.url
    page.keyboard.press("Escape")
    page.goto(f"{dashboard.url}?page=runs")
    page.get_by_role("button", name="Views").click()
    page.get_by_role("link", name="for the paper").click()
    expect(search).to_have_value("iteration>=3 and name:finished")
    assert "metric.length.mean_5" in page.url
    assert "metric.length.mean_5" in shown
    page.get_by_role("button", name="Tags").click()
    page.get_by_role("group", name="Tags").get_by_role("button", name="größe").click()
    expect(search).to_have_value("iteration>=3 and name:finished and tag:größe")
