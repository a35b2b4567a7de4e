"""How people get in, and that every page is for everybody."""

import json
from collections.abc import Callable
from typing import Any

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import BrowserContext, Page, expect
from written_runs import make_run

WCAG = {"runOnly": ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice"]}
START_DIALOGS = {"Start a run": "One run", "Start a sweep": "Sweep"}


def test_the_printed_link_opens_a_session_once(
    open_context: Callable[..., BrowserContext], dashboard: Any, watch: Any
) -> None:
    watch.allow("401|403")
    context = open_context()
    page = context.new_page()
    page.goto(dashboard.link)
    expect(page.get_by_role("heading", name="Runs", level=1)).to_be_visible()
    assert "token" not in page.url
    (cookie,) = context.cookies()
    assert cookie["httpOnly"]
    assert cookie["sameSite"] == "Strict"
    assert page.evaluate("JSON.stringify({...localStorage, ...sessionStorage})").count("bpn_") == 0
    page.reload()
    expect(page.get_by_role("heading", name="Runs", level=1)).to_be_visible()
    elsewhere = open_context().new_page()
    elsewhere.goto(dashboard.link)
    expect(elsewhere.get_by_role("heading", name="Runs", level=1)).to_have_count(0)
    expect(elsewhere.get_by_role("textbox")).to_be_visible()


@pytest.fixture(scope="module")
def compared(dashboard: Any, wait_for: Callable[..., None]) -> None:
    """Two values of alpha with two seeds each, so that pages that compare have something to say."""
    for alpha in (0.5, 0.95):
        for seed in (0, 1):
            make_run(dashboard, wait_for, alpha=alpha, seed=seed)


def views(run: str) -> dict[str, str]:
    tabs = ("curves", "live", "episodes", "files", "config", "logs")
    return {
        "runs": "?page=runs",
        "sweeps": "?page=sweeps",
        "compare, nothing chosen": "?page=compare",
        "compare": f"?page=compare&runs={run}",
        "compare, configuration": f"?page=compare&runs={run}&tab=configuration",
        "heat map": "?page=compare&task=reaching&tab=heatmap",
        "results": "?page=compare&task=reaching&tab=results",
        "scatter": "?page=compare&task=reaching&tab=scatter",
        "parallel": "?page=compare&task=reaching&tab=parallel",
        "queue": "?page=queue",
        "runs, a wrong query": "?page=runs&query=alpha%3E",
        "trash": "?page=trash",
        "system": "?page=system",
        "nowhere": "?page=nowhere",
        **{f"run, {tab}": f"?page=run&run={run}&tab={tab}" for tab in tabs},
    }


def settle(page: Page) -> None:
    """Waits until everything of a page is drawn; charts are when they are seen."""
    main = page.get_by_role("main")
    loading = main.get_by_role("status", name="Loading")
    expect(main.get_by_role("heading", level=1)).to_be_attached()
    expect(main.locator(".skeleton")).to_have_count(0)
    for figure in main.get_by_role("figure").all():
        figure.scroll_into_view_if_needed()
        expect(figure.get_by_role("status", name="Loading")).to_have_count(0)
    expect(loading).to_have_count(0)
    # Back at the top: elsewhere the bar that stays there may cover half a button, wherever the last figure stands.
    page.evaluate(
        "document.querySelectorAll('*').forEach(one => { if (one.scrollTop) one.scrollTop = 0 })"
    )


@pytest.mark.usefixtures("compared")
@pytest.mark.parametrize("theme", ["light", "dark"])
def test_axe_finds_nothing(
    sign_in: Callable[..., Page], dashboard: Any, watch: Any, finished: str, theme: str
) -> None:
    watch.allow("422")  # the wrong query
    page = sign_in(color_scheme=theme)
    found = {}
    for name, query in views(finished).items():
        page.goto(dashboard.url + query)
        settle(page)
        results = Axe().run(page, options=WCAG)
        if results.violations_count:
            found[name] = [
                (v["id"], [(node["html"][:200], node["failureSummary"]) for node in v["nodes"]])
                for v in results.response["violations"]
            ]
    assert found == {}, json.dumps(found, indent=1)


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_axe_finds_nothing_in_the_start_dialog(sign_in: Callable[..., Page], theme: str) -> None:
    page = sign_in(color_scheme=theme)
    page.get_by_role("button", name="Start run").click()
    for name, kind in START_DIALOGS.items():
        page.get_by_role("dialog").get_by_role("button", name=kind, exact=True).click()
        expect(page.get_by_role("dialog", name=name)).to_be_visible()
        results = Axe().run(page, options=WCAG)
        assert results.violations_count == 0, results.generate_report()


WIDE = """[...document.querySelectorAll('body *:not(nav *)')]
  .filter((element) => element.getBoundingClientRect().right > innerWidth
    || element.scrollWidth > element.clientWidth + 1 && getComputedStyle(element).overflowX === 'visible')
  .map((element) => `${element.outerHTML.slice(0, 100)}: ${element.scrollWidth} px`)"""


@pytest.mark.usefixtures("compared")
def test_no_page_is_wider_than_a_phone(
    sign_in: Callable[..., Page], dashboard: Any, watch: Any, finished: str
) -> None:
    watch.allow("422")  # the wrong query
    page = sign_in(viewport={"width": 360, "height": 740})
    for name, query in views(finished).items():
        page.goto(dashboard.url + query)
        settle(page)
        width = page.evaluate("document.documentElement.scrollWidth")
        assert width <= 360, f"{name} is {width} px wide: {page.evaluate(WIDE)}"
        out_of_sight = page.evaluate(
            "(nav) => nav.scrollWidth - nav.clientWidth",
            page.get_by_role("navigation", name="Pages").element_handle(),
        )
        assert out_of_sight <= 0, f"{name}: not all pages of the navigation are in sight"
    page.goto(f"{dashboard.url}?page=runs")
    page.get_by_role("button", name="Start run").click()
    dialog = page.get_by_role("dialog")
    for name, kind in START_DIALOGS.items():
        dialog.get_by_role("button", name=kind, exact=True).click()
        expect(page.get_by_role("dialog", name=name)).to_be_visible()
        width = dialog.evaluate("dialog => dialog.scrollWidth")
        assert width <= 360, f"the dialog is {width} px wide: {page.evaluate(WIDE)}"


def test_everything_by_keyboard_alone(page: Page, finished: str) -> None:
    keyboard = page.keyboard
    keyboard.press("?")
    expect(page.get_by_role("dialog", name="Keyboard shortcuts")).to_be_visible()
    keyboard.press("Escape")
    keyboard.press("/")
    keyboard.type("finished run")
    row = page.get_by_role("row", name="finished run")
    expect(row).to_be_visible()
    expect(page.get_by_role("region", name="Runs").get_by_role("rowheader")).to_have_count(1)
    page.get_by_role("searchbox").blur()
    keyboard.press("j")
    keyboard.press("x")
    expect(row.get_by_role("checkbox")).to_be_checked()
    keyboard.press("Enter")
    expect(page.get_by_role("heading", name="finished run", level=1)).to_be_visible()
    assert finished in page.url
    keyboard.press("3")
    player = page.get_by_role("region", name="Episode 0 of iteration 2")
    expect(player.get_by_role("slider", name="Step")).to_have_value("0")
    keyboard.press(".")
    keyboard.press(".")
    expect(player.get_by_role("slider", name="Step")).to_have_value("2")
    keyboard.press(",")
    expect(player.get_by_role("slider", name="Step")).to_have_value("1")
    keyboard.press("g")
    keyboard.press("s")
    expect(page.get_by_role("heading", name="System", level=1)).to_be_visible()
    keyboard.press("g")
    keyboard.press("r")
    expect(page.get_by_role("heading", name="Runs", level=1)).to_be_visible()
