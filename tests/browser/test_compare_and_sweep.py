"""Two runs beside each other, and a sweep as a heat map that leads to its runs."""

import re
from typing import Any

import pytest
from playwright.sync_api import Page, expect


@pytest.mark.usefixtures("finished")
def test_compare_two_runs(page: Page, dashboard: Any, wait_for: Any) -> None:
    other = dashboard.start(name="other seed", seed=7)
    wait_for(lambda: dashboard.state(other) == "finished", "the other run", 120)
    page.goto(f"{dashboard.url}?page=runs")
    for name in ("finished run", "other seed"):
        page.get_by_role("checkbox", name=f"Select {name}").check()
    page.get_by_role("toolbar", name="Chosen runs").get_by_role("button", name="Compare").click()
    expect(page.get_by_role("heading", name="Compare", level=1)).to_be_visible()
    figure = page.get_by_role("figure", name=re.compile("^Return"))
    expect(figure).to_have_attribute("data-ready", "true")
    expect(figure.get_by_role("button", name=re.compile("^finished run"))).to_be_visible()
    expect(figure.get_by_role("button", name=re.compile("^other seed"))).to_be_visible()
    stroke = figure.get_by_role("button", name="Colour of other seed")
    colour = page.get_by_role("group", name="Colour of other seed").get_by_role("button")
    for name in ("pink", "green"):  # whichever it had, it has the last one now
        stroke.click()
        colour.and_(page.get_by_label(name, exact=True)).click()
    green = stroke.locator("path").get_attribute("stroke")
    shared = page.url
    page.get_by_role("navigation", name="Views").get_by_role("link", name="Configuration").click()
    expect(page.get_by_role("row", name=re.compile("other seed"))).to_contain_text("7")
    page.goto(shared)  # a link shows what was shown, in the colours that were chosen
    expect(stroke.locator("path")).to_have_attribute("stroke", str(green))
    expect(figure.get_by_role("button", name=re.compile("^other seed"))).to_be_visible()


def test_the_heat_map_of_a_sweep_leads_to_its_runs(
    page: Page, dashboard: Any, wait_for: Any
) -> None:
    page.get_by_role("link", name="Sweeps").click()
    page.get_by_role("button", name=re.compile("^Start (the first )?sweep")).first.click()
    dialog = page.get_by_role("dialog", name="Start a sweep")
    dialog.get_by_label("Name").fill("alpha by N")
    dialog.get_by_role("radio", name="Reaching", exact=True).check()
    for i, (key, values) in enumerate({"alpha": "0.5, 0.95", "hidden_units": "16, 24"}.items(), 1):
        dialog.get_by_role("button", name="Add a key").click()
        dialog.get_by_label(f"Key {i}").select_option(key)
        dialog.get_by_label(f"Values of {key}").fill(values)
    dialog.get_by_label("Seeds").fill("0")
    for summary in dialog.locator("summary").all():
        if summary.locator("..").get_attribute("open") is None:
            summary.click()
    for key, value in {"iterations": "2", "episodes": "3", "epochs": "2", "steps": "6"}.items():
        dialog.get_by_label(key, exact=True).fill(value)
    dialog.get_by_role("button", name="Start 4 runs").click()

    expect(page.get_by_role("heading", name="Runs", level=1)).to_be_visible()
    sweep = dashboard.ask("GET", "/sweeps")["items"][0]
    wait_for(
        lambda: dashboard.ask("GET", f"/sweeps/{sweep['id']}")["states"] == {"finished": 4},
        "the sweep to finish",
        180,
    )
    page.goto(f"{dashboard.url}?page=compare&sweep_id={sweep['id']}&tab=heatmap")
    heatmap = page.get_by_role("region", name="Heat map")
    cells = heatmap.get_by_role("link")
    expect(cells).to_have_count(4)
    heatmap.get_by_role(
        "link", name=re.compile("alpha 0.95.*hidden_units 16|hidden_units 16.*alpha 0.95")
    ).click()
    expect(page.get_by_role("heading", name="Runs", level=1)).to_be_visible()
    expect(page.get_by_role("region", name="Runs").get_by_role("rowheader")).to_have_count(1)
