"""What people do with one run, from the dialog that starts it to the weights that it leaves."""

import re
from pathlib import Path
from typing import Any

import numpy as np
from paper import TASKS
from playwright.sync_api import Locator, Page, expect

from bpn_shared.bnn import golden
from bpn_shared.bnn.blob import WeightBlob
from bpn_shared.messages.episode import Episode


def open_run(page: Page, dashboard: Any, run: str, tab: str = "curves") -> None:
    page.goto(f"{dashboard.url}?page=run&run={run}&tab={tab}")
    expect(page.get_by_role("heading", level=1)).to_be_visible()


def stop(page: Page) -> None:
    page.get_by_role("main").get_by_role("button", name="Stop").click()
    page.get_by_role("dialog").get_by_role("button", name="Stop").click()


def choose_reaching_with(dialog: Locator, values: dict[str, str]) -> None:
    dialog.get_by_role("radio", name="Reaching", exact=True).check()
    for summary in dialog.locator("summary").all():  # sections that are closed hide their fields
        if summary.locator("..").get_attribute("open") is None:
            summary.click()
    for key, value in values.items():
        dialog.get_by_label(key, exact=True).fill(value)


def test_start_watch_stop_and_resume_a_run(page: Page) -> None:
    page.get_by_role("button", name="Start run").click()
    dialog = page.get_by_role("dialog", name="Start a run")
    dialog.get_by_label("Name").fill("from the dialog")
    choose_reaching_with(
        dialog,
        {"iterations": "5000", "episodes": "4", "epochs": "2", "hidden_units": "24", "steps": "8"},
    )
    dialog.get_by_role("button", name="Start run").click()

    expect(page.get_by_role("heading", name="from the dialog", level=1)).to_be_visible()
    expect(page.get_by_text("running", exact=True)).to_be_visible()
    progress = page.get_by_role("progressbar", name="Iteration")
    expect(progress).not_to_have_attribute("value", "0")
    chart = page.get_by_role("application", name=re.compile("^Return, px"))
    expect(chart).to_be_visible()
    expect(page.get_by_role("figure", name=re.compile("^Return"))).to_have_attribute(
        "data-ready", "true"
    )

    stop(page)
    expect(page.get_by_text("stopped", exact=True)).to_be_visible()
    reached = int(progress.get_attribute("value") or 0)
    page.get_by_role("main").get_by_role("button", name="Resume").click()
    expect(page.get_by_text("running", exact=True)).to_be_visible()
    page.wait_for_function(
        "([bar, before]) => bar.value > before", arg=[progress.element_handle(), reached]
    )
    page.keyboard.press("s")  # asks as the button does
    page.get_by_role("dialog").get_by_role("button", name="Stop").click()
    expect(page.get_by_text("stopped", exact=True)).to_be_visible()


def test_a_gymnasium_environment_is_started_like_any_task(page: Page, watch: Any) -> None:
    watch.allow("422")
    page.get_by_role("button", name="Start run").click()
    dialog = page.get_by_role("dialog", name="Start a run")
    dialog.get_by_role("radio", name="Gymnasium").check()
    dialog.get_by_role("button", name="Start run").click()
    expect(
        dialog.get_by_text("must be [MODULE:]ENVIRONMENT-ID, such as CartPole-v1")
    ).to_be_visible()
    environment = dialog.get_by_label("Environment", exact=True)
    environment.fill("gymnasium.envs.classic_control:MountainCar-v0")
    dialog.get_by_role("button", name="Start run").click()
    expect(dialog.get_by_text("needs the module 'gymnasium")).to_be_visible(timeout=30_000)
    environment.fill("MountainCar-v0")
    dialog.locator("summary", has_text="Environment").click()
    dialog.get_by_label("crop", exact=True).fill("0,50,600,300")
    dialog.get_by_label("Name").fill("a car")
    dialog.get_by_role("button", name="Start run").click()
    expect(page.get_by_role("heading", name="a car", level=1)).to_be_visible(timeout=30_000)
    stop(page)


LINE_PIXELS = """figure => {
  const canvas = figure.querySelector('canvas');
  const { data } = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
  let coloured = 0;
  for (let i = 0; i < data.length; i += 4)
    coloured += data[i + 3] > 200 && Math.max(...data.slice(i, i + 3)) - Math.min(...data.slice(i, i + 3)) > 60;
  return coloured;
}"""


def test_a_line_is_drawn_again_whatever_changes(
    page: Page, dashboard: Any, finished: str, watch: Any
) -> None:
    watch.allow("willReadFrequently")  # we do read pixels
    open_run(page, dashboard, finished)
    figure = page.get_by_role("figure", name=re.compile("^Return"))
    expect(figure).to_have_attribute("data-ready", "true")
    figure.get_by_role("button", name="Colour of Return").click()  # black has no colour to count
    colours = page.get_by_role("group", name="Colour of Return")
    colours.get_by_role("button", name="blue", exact=True).click()

    def line_pixels() -> int:
        expect(figure).to_have_attribute("data-ready", "true")
        pixels: int = figure.evaluate(LINE_PIXELS)
        return pixels

    drawn = line_pixels()
    assert drawn > 100
    figure.get_by_role("application").focus()
    page.keyboard.press("+")
    expect(figure.get_by_title("Show all again (0)")).to_be_visible()
    assert line_pixels() > 100
    page.keyboard.press("0")
    expect(figure.get_by_title("Show all again (0)")).to_have_count(0)
    assert abs(line_pixels() - drawn) < drawn / 10
    line = figure.get_by_role("button", name=re.compile("^Return .*px"))
    line.click()
    expect(line).to_have_attribute("aria-pressed", "false")
    assert line_pixels() == 0
    line.click()
    page.emulate_media(color_scheme="dark")
    expect(page.locator("html[data-theme=dark]")).to_be_attached()
    assert abs(line_pixels() - drawn) < drawn / 10


def test_play_an_episode(page: Page, dashboard: Any, finished: str) -> None:
    open_run(page, dashboard, finished, "episodes")
    page.get_by_role("button", name="Iteration before").click()
    page.get_by_role("button", name="Episode 2").click()
    player = page.get_by_role("region", name="Episode 2 of iteration 1")
    step = player.get_by_role("slider", name="Step")
    expect(step).to_have_value("0")
    player.get_by_label("Speed").select_option("4×")
    player.get_by_role("button", name="Play").click()
    expect(step).to_have_value("8")  # the last frame: it plays to its end and stops there
    expect(player.get_by_role("button", name="Play")).to_be_visible()
    expect(player.get_by_text("the episode is over")).to_be_visible()

    player.get_by_role("button", name="One step back").click()
    expect(step).to_have_value("7")
    chosen = player.get_by_role("row", name=re.compile("chosen"))
    stored = dashboard.ask("GET", f"/runs/{finished}/episodes/1/2")
    name = stored["action_names"][stored["actions"][7]].replace("-", "\N{MINUS SIGN}")
    expect(chosen).to_contain_text(name)
    expect(player.get_by_role("definition").filter(has_text=name)).to_be_visible()
    assert "t=7" in page.url  # a link to this very frame
    page.reload()
    expect(step).to_have_value("7")
    # What is drawn is what is stored: the newest frame, pixel by pixel.
    drawn = player.get_by_role("img", name="Frame 7, newest frame").evaluate(
        "canvas => Array.from(canvas.getContext('2d').getImageData(0, 0, 84, 84).data)"
    )
    shown = np.array(drawn, np.uint8).reshape(84, 84, 4)
    path = dashboard.runs_dir / finished / "episodes" / "000001-00002.bpne"
    frames = Episode.decode(path.read_bytes(), TASKS["reaching"]).frames
    assert np.array_equal(shown[..., 0], frames[7, 0])


def test_download_weights_and_decode_them(
    page: Page, dashboard: Any, finished: str, tmp_path: Path
) -> None:
    open_run(page, dashboard, finished, "files")
    with page.expect_download() as download:
        page.get_by_role("link", name="Download weights version 3").click()
    path = tmp_path / "weights.bpnw"
    download.value.save_as(path)
    blob = WeightBlob.decode(path.read_bytes())
    assert (blob.version, str(blob.run)) == (3, finished)
    outputs = golden.forward(blob, np.zeros(blob.spec.observation_shape, np.uint8))
    assert len(outputs[-1]) == 14  # an action's preference each


def test_logs_are_searched_and_downloaded(
    page: Page, dashboard: Any, finished: str, tmp_path: Path
) -> None:
    open_run(page, dashboard, finished, "logs")
    log = page.get_by_role("log", name="Log of the run")
    expect(log.get_by_role("listitem").first).to_be_visible()
    page.get_by_role("searchbox", name="Search in messages").fill("weights version")
    page.wait_for_function(
        "() => { const all = [...document.querySelectorAll('[role=log] li')];"
        " return all.length > 0 && all.every((line) => line.textContent.includes('weights version')); }"
    )
    assert "search=weights" in page.url
    with page.expect_download() as download:
        page.get_by_role("button", name="Download").click()
    path = tmp_path / "log.jsonl"
    download.value.save_as(path)
    assert all("weights version" in line for line in path.read_text().splitlines())
    page.get_by_role("searchbox", name="Search in messages").fill("nobody says this")
    expect(page.get_by_text("No line matches")).to_be_visible()


def test_configuration_and_its_difference(page: Page, dashboard: Any, finished: str) -> None:
    other = dashboard.start(name="with another beta", beta=2.5, iterations=1)
    open_run(page, dashboard, finished, "config")
    row = page.get_by_role("row", name=re.compile("^hidden_units"))
    expect(row).to_contain_text("24")
    expect(row).to_contain_text("preset 256")
    page.get_by_label("Other run", exact=True).select_option(value=other)
    difference = page.get_by_role("region", name="Difference to another run")
    expect(difference.get_by_role("row", name="beta 1 2.5")).to_be_visible()
    expect(difference.get_by_role("row")).to_have_count(3)  # a head, beta, iterations


def test_notes_and_tags_are_kept(page: Page, dashboard: Any, finished: str) -> None:
    open_run(page, dashboard, finished)
    page.get_by_role("button", name="Edit").click()
    dialog = page.get_by_role("dialog", name="Name, notes and tags")
    dialog.get_by_label("Notes").fill("<b>looks</b> fine")
    dialog.get_by_label("Tags").fill("good, kept")
    dialog.get_by_role("button", name="Save").click()
    expect(dialog).to_be_hidden()
    expect(page.get_by_text("<b>looks</b> fine")).to_be_visible()
    run = dashboard.ask("GET", f"/runs/{finished}")
    assert (run["notes"], run["tags"]) == ("<b>looks</b> fine", ["good", "kept"])


def test_what_somebody_else_changed_is_not_overwritten(
    page: Page, dashboard: Any, finished: str, watch: Any
) -> None:
    watch.allow("412")
    open_run(page, dashboard, finished)
    page.get_by_role("button", name="Edit").click()
    dialog = page.get_by_role("dialog", name="Name, notes and tags")
    dialog.get_by_label("Notes").fill("mine")
    before = dashboard.ask("GET", f"/runs/{finished}")
    dashboard.patch(finished, before["rev"], {"notes": "theirs"})
    dialog.get_by_role("button", name="Save").click()
    expect(dialog.get_by_role("alert")).to_contain_text("Somebody else changed the same")
    expect(dialog.get_by_text("theirs", exact=True)).to_be_visible()
    assert dashboard.ask("GET", f"/runs/{finished}")["notes"] == "theirs"
    dialog.get_by_role("button", name="Save").click()
    expect(dialog).to_be_hidden()
    assert dashboard.ask("GET", f"/runs/{finished}")["notes"] == "mine"

    # What somebody else changed in another field stays, without a question.
    page.get_by_role("button", name="Edit").click()
    dialog.get_by_label("Tags").fill("my tag")
    before = dashboard.ask("GET", f"/runs/{finished}")
    dashboard.patch(finished, before["rev"], {"notes": "theirs again"})
    dialog.get_by_role("button", name="Save").click()
    expect(dialog).to_be_hidden()
    run = dashboard.ask("GET", f"/runs/{finished}")
    assert (run["notes"], run["tags"]) == ("theirs again", ["my tag"])


def test_a_run_that_is_not_there_is_said_so(page: Page, dashboard: Any, watch: Any) -> None:
    watch.allow("404")
    page.goto(f"{dashboard.url}?page=run&run=01a20292-0000-7000-8000-000000000000")
    expect(page.get_by_text("There is no run 00000000")).to_be_visible()
