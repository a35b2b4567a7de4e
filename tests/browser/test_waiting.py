"""A run that does not go on says why, where people look for it."""

import re
from collections.abc import Iterator
from typing import Any

import pytest
from playwright.sync_api import Page, expect


@pytest.fixture
def waiting(dashboard: Any) -> Iterator[str]:
    """A run that wants more learners than there are."""
    run = dashboard.start(learners=9, batch_size=32, name="wants nine learners")
    yield run
    dashboard.ask("POST", f"/runs/{run}/stop")


def test_its_page_and_the_table_say_why_it_waits(page: Page, dashboard: Any, waiting: str) -> None:
    page.goto(f"{dashboard.url}?page=run&run={waiting}&tab=curves")
    reason = page.get_by_role("status").filter(has_text=re.compile("(Waiting|No progress) for "))
    expect(reason).to_contain_text("learner")
    told = dashboard.ask("GET", f"/runs/{waiting}")["waiting_reason"]
    assert told
    expect(reason).to_contain_text(told)
    page.goto(f"{dashboard.url}?page=runs")
    row = page.get_by_role("row").filter(has_text="wants nine learners")
    expect(row.get_by_title(told)).to_be_visible()
