"""A run that does not go on says why, where people look for it."""

from typing import Any

import pytest
from playwright.sync_api import Page, expect

REASON = "waits for a learner: "


@pytest.fixture
def waiting(dashboard: Any) -> Any:
    """A run that wants more learners than there are."""
    run = dashboard.start(learners=9, batch=32, name="wants nine learners")
    yield run
    dashboard.ask("POST", f"/runs/{run}/stop")


def test_its_page_and_the_table_say_why_it_waits(page: Page, dashboard: Any, waiting: str) -> None:
    page.goto(f"{dashboard.url}?page=run&run={waiting}&tab=curves")
    header = page.locator("header", has=page.get_by_role("heading", name="wants nine learners"))
    told = dashboard.ask("GET", f"/runs/{waiting}")["waiting_reason"]
    expect(header).to_contain_text("learner")
    assert told
    expect(header).to_contain_text(dashboard.ask("GET", f"/runs/{waiting}")["waiting_reason"])
    page.goto(f"{dashboard.url}?page=runs")
    row = page.get_by_role("row", name="wants nine learners")
    expect(row.get_by_title("learner")).to_be_visible()
