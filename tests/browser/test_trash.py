"""Runs are deleted with undo, found in the trash, and restored; a page that shows one follows."""

from typing import Any

from playwright.sync_api import Page, expect


def test_deleted_undone_deleted_and_restored(page: Page, dashboard: Any, watch: Any) -> None:
    watch.allow("404")  # of the page whose run is gone
    run = dashboard.start(name="to be deleted", iterations=50)
    dashboard.ask("POST", f"/runs/{run}/stop")
    page.goto(f"{dashboard.url}?page=run&run={run}")
    main = page.get_by_role("main")
    main.get_by_role("button", name="Delete").click()
    expect(page.get_by_text("1 run moved to the trash")).to_be_visible()
    expect(page.get_by_text("There is no run")).to_be_visible()
    page.get_by_role("button", name="Undo").click()
    expect(page.get_by_role("heading", name="to be deleted", level=1)).to_be_visible()

    main.get_by_role("button", name="Delete").click()
    expect(page.get_by_text("There is no run")).to_be_visible()
    page.get_by_role("link", name="Trash").click()
    expect(page.get_by_role("heading", name="Trash", level=1)).to_be_visible()
    removed = page.get_by_role("listitem").filter(has_text="to be deleted")
    expect(removed.get_by_text("kept until")).to_be_visible()
    expect(removed.get_by_text("KiB")).to_be_visible()
    expect(removed.get_by_role("button", name="Delete for good")).to_be_disabled()  # an operator
    removed.get_by_role("button", name="Restore").click()
    expect(removed).to_have_count(0)
    assert dashboard.state(run) == "stopped"


def test_old_runs_are_shown_before_they_go_and_come_back_together(
    page: Page, dashboard: Any
) -> None:
    for name in ("old one", "old two"):
        run = dashboard.start(name=name, iterations=50)
        dashboard.ask("POST", f"/runs/{run}/stop")
    before = {run["id"] for run in dashboard.runs()}
    page.goto(f"{dashboard.url}?page=trash")
    page.get_by_role("button", name="Old runs").click()
    dialog = page.get_by_role("dialog", name="Move old runs to the trash")
    dialog.get_by_label("Keep runs to which something happened").fill("1")
    expect(dialog.get_by_text("No run is that old.")).to_be_visible()
    dialog.get_by_label("Keep runs to which something happened").fill("")
    dialog.get_by_label("Keep so many of the newest runs").fill("0")
    expect(
        dialog.get_by_role("listitem").first
    ).to_be_visible()  # the oldest, of which others may be
    dialog.get_by_role("button", name="Move to the trash").click()
    expect(page.get_by_text("moved to the trash")).to_be_visible()
    assert not {run["id"] for run in dashboard.runs()} & {
        r["id"] for r in dashboard.ask("GET", "/trash")["items"]
    }
    page.get_by_role("button", name="Undo").click()
    expect(page.get_by_text("back from the trash")).to_be_visible()
    assert {run["id"] for run in dashboard.runs()} == before


def test_what_others_delete_leaves_the_list(page: Page, dashboard: Any) -> None:
    run = dashboard.start(name="deleted elsewhere", iterations=50)
    dashboard.ask("POST", f"/runs/{run}/stop")
    row = page.get_by_role("row").filter(has_text="deleted elsewhere")
    expect(row).to_be_visible()
    dashboard.ask("DELETE", f"/runs/{run}")
    expect(row).to_have_count(0)
    dashboard.ask("POST", f"/trash/{run}/restore")
    expect(row).to_be_visible()
    row.get_by_role("checkbox").check()
    page.get_by_role("toolbar", name="Chosen runs").get_by_role("button", name="Delete").click()
    expect(row).to_have_count(0)
    assert [item["id"] for item in dashboard.ask("GET", "/trash")["items"]] == [run]
    dashboard.ask("POST", f"/trash/{run}/restore")
