"""A task, an algorithm, a kernel and a callback of other packages, in the start dialog as ours are."""

import re
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from typing import Any

import pytest
from example_packages import ALL, install_examples
from playwright.sync_api import Locator, Page, expect

from bpn_shared.runs.folder import RunFolder


@pytest.fixture(scope="module")
def dashboard(
    begin_dashboard: Callable[..., AbstractContextManager[Any]],
    tmp_path_factory: pytest.TempPathFactory,
) -> Iterator[Any]:
    """One where the examples are installed."""
    site = tmp_path_factory.mktemp("site")
    with begin_dashboard(install_examples(site, *ALL)) as one:
        yield one


def fill(dialog: Locator, section: str, **values: str) -> None:
    title = re.compile(rf"^\s*{re.escape(section)}\b")
    group = dialog.locator("details", has=dialog.page.locator("summary", has_text=title))
    if group.get_attribute("open") is None:
        group.locator("summary").click()
    for name, value in values.items():
        group.get_by_label(name, exact=True).fill(value)


def test_they_are_chosen_and_trained(
    page: Page, dashboard: Any, watch: Any, wait_for: Callable[..., None]
) -> None:
    watch.allow("422")
    before = {run["id"] for run in dashboard.runs()}
    page.get_by_role("button", name="Start run").click()
    dialog = page.get_by_role("dialog", name="Start a run")
    dialog.get_by_role("radio", name="Dot to the centre").check()
    dialog.get_by_label("algorithm", exact=True).select_option("hedged")
    fill(dialog, "Run", iterations="2")
    fill(dialog, "Data of an iteration", episodes="2")
    fill(dialog, "Policy update", epochs="1")
    fill(dialog, "Evaluation, early end, callbacks", callbacks="nobody")
    fill(dialog, "Where and how it runs", kernel="blas")
    dialog.get_by_label("Name").fill("all my own")
    dialog.get_by_role("button", name="Start run").click()
    refusal = dialog.get_by_role("alert")
    expect(refusal).to_contain_text("callback 'nobody' is not installed at any of the 1 connected")
    assert {run["id"] for run in dashboard.runs()} == before

    fill(dialog, "Evaluation, early end, callbacks", callbacks="gap")
    dialog.get_by_role("button", name="Start run").click()
    expect(page.get_by_role("heading", name="all my own", level=1)).to_be_visible()
    (run,) = {run["id"] for run in dashboard.runs()} - before
    wait_for(lambda: dashboard.state(run) not in {"queued", "running"}, "the run to end", 240.0)
    assert dashboard.state(run) == "finished"
    folder = RunFolder.open(dashboard.runs_dir, run)
    config = folder.config()
    chosen = (config.task, config.algorithm, config.kernel, config.callbacks)
    assert chosen == ("centre", "hedged", "blas", "gap")
    assert "return_change" in folder.metrics()[1]
