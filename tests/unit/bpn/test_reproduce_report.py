"""Documents to figures and tables, with results made by hand."""

import json
import re
from pathlib import Path

import pytest
from reproduced import ITERATIONS, RESULTS, made

from bpn.cli import main
from bpn.reproduce import averaging, heatmap, report
from bpn.reproduce.caption import QUICK
from bpn.reproduce.targets import TARGETS


@pytest.mark.parametrize("name", TARGETS)
def test_a_document_survives_its_file_and_gives_figure_and_table(name: str, tmp_path: Path) -> None:
    document = made(name)
    paths = report.write(TARGETS[name], document, tmp_path / "results")
    assert [path.name for path in paths] == [f"{name}.json", f"{name}.png", f"{name}.md"]
    again = json.loads(paths[0].read_text())
    assert again == json.loads(json.dumps(document))
    assert TARGETS[name].table(again) == TARGETS[name].table(document)
    assert paths[1].read_bytes().startswith(b"\x89PNG")
    page = paths[2].read_text()
    assert f"`bpn reproduce {name}`" in page
    assert QUICK not in page
    assert QUICK in report.page(TARGETS[name], made(name, quick=True))


def test_figure_and_table_are_drawn_anew_from_the_results_alone(tmp_path: Path) -> None:
    paths = report.write(TARGETS["tracking"], made("tracking"), tmp_path)
    before = [path.read_bytes() for path in paths]
    for drawn in paths[1:]:
        drawn.unlink()
    assert main(["reproduce", "tracking", "--redraw", "--out", str(tmp_path)]) == 0
    assert [path.read_bytes() for path in paths] == before


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ([], "reproduce reaching"),
        (["--seeds", "2"], "--seeds says nothing"),
        (["--hidden-units", "32"], "--hidden-units says nothing"),
    ],
)
def test_what_cannot_be_drawn_anew_is_said(
    options: list[str], says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["reproduce", "reaching", "--redraw", "--out", str(tmp_path), *options]
    assert main(arguments) == 2
    assert says in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "content", ["[]", "{}", '{"target": "tracking"}', '{"target": "reaching"}', "{"]
)
def test_a_file_of_something_else_is_not_drawn(content: str, tmp_path: Path) -> None:
    (tmp_path / "reaching.json").write_text(content)
    assert main(["reproduce", "reaching", "--redraw", "--out", str(tmp_path)]) == 2
    assert [path.name for path in tmp_path.iterdir()] == ["reaching.json"]


@pytest.mark.parametrize("name", TARGETS)
def test_every_row_of_a_table_has_as_many_cells_as_its_heading(name: str) -> None:
    parts = TARGETS[name].table(made(name)).split("\n\n")
    for table in (part for part in parts if part.startswith("|")):
        widths = {line.count("|") for line in table.splitlines()}
        assert len(widths) == 1
        assert len(table.splitlines()) > 2


def test_each_run_is_a_line_of_the_json_file() -> None:
    lines = report.to_json(made("tracking")).splitlines()
    assert sum('"run_id"' in line for line in lines) == len(RESULTS["tracking"][0])


def test_a_learning_table_shows_lengths_beside_returns_and_the_gap_to_float() -> None:
    rows = {
        tuple(row.split(" | ")[:2]): row
        for row in TARGETS["tracking"].table(made("tracking")).splitlines()
    }
    bqn = rows["| BQN", "100"]
    assert "| 80.0 |" in bqn  # per cent of the episodes kept the target
    assert "38.0" in bqn  # steps
    assert (
        "-796.5 (-806.5 to -786.5)" in bqn
    )  # of the last ten of -800 + 10 seed - i, seeds 0, 1, 2
    assert "+0.0 %" in bqn  # as float CVI returns
    assert "n = 3" in _legend("tracking")


def _legend(name: str) -> str:
    figure = TARGETS[name].draw(made(name))
    return " ".join(text.get_text() for legend in figure.legends for text in legend.get_texts())


@pytest.mark.parametrize("name", ["reaching", "tracking", "heatmap", "pan-tilt", "latency"])
def test_one_seed_has_no_spread_and_its_repetitions_are_no_seeds(name: str) -> None:
    document = made(name)
    trials = [one for one in document["result"].get("trials", []) if one["seed"] == 0]
    document["runs"] = [run for run in document["runs"] if run["seed"] == 0] * 4
    document["result"] = document["result"] | {"trials": trials}
    table = TARGETS[name].table(document)
    assert "±" not in table
    assert not re.search(r"\(-?[\d.]+ to -?[\d.]+\)", table)
    if name in ("reaching", "tracking", "heatmap"):
        assert "| 1 (4 runs) |" in table
    TARGETS[name].draw(document)


def test_learning_figures_have_a_column_for_every_n_and_lengths_only_where_episodes_end_early() -> (
    None
):
    assert len(TARGETS["tracking"].draw(made("tracking")).axes) == 3 * 2
    never_lost = made("reaching")
    never_lost["runs"] = [run | {"failures": [0] * ITERATIONS} for run in never_lost["runs"]]
    assert len(TARGETS["reaching"].draw(never_lost).axes) == 2


def test_where_episodes_end_early_no_iteration_is_called_the_best() -> None:
    assert "best iteration" not in TARGETS["tracking"].table(made("tracking"))
    never_lost = made("reaching")
    never_lost["runs"] = [run | {"failures": [0] * ITERATIONS} for run in never_lost["runs"]]
    assert "best iteration" in TARGETS["reaching"].table(never_lost)


def test_a_heat_map_cell_holds_a_value_of_each_seed() -> None:
    cells = heatmap.cells(made("heatmap"))
    assert [(cell["hidden_units"], cell["alpha"]) for cell in cells] == [
        (16, 0),
        (16, 0.95),
        (32, 0),
        (32, 0.95),
    ]
    assert cells[0]["best_return_px"].tolist() == [-800, -790, -780]
    assert "| 16 | 0 | 3 | -790 (-800 to -780) |" in TARGETS["heatmap"].table(made("heatmap"))
    short = made("heatmap")
    short["runs"] = [run | {"returns_px": run["returns_px"][:2]} for run in short["runs"]]
    assert "last 2 iterations" in TARGETS["heatmap"].table(short)


def test_the_tracking_time_table_pools_trials_and_shows_every_seed() -> None:
    rows = TARGETS["pan-tilt"].table(made("pan-tilt")).splitlines()
    bpn, bqn = (next(row for row in rows if f"| {name}" in row) for name in ("BPN", "BQN"))
    assert "3/6 (1/2, 1/2, 1/2)" in bpn
    assert "| 11.6 | 100 |" in bpn
    assert "| 1/2 |" in bqn  # one seed has no spread


def test_cartpole_says_of_how_many_steps_and_how_many_trials_reached_the_end() -> None:
    document = made("cartpole")
    document["runs"] = [run | {"frame_skip": 3} for run in document["runs"]]
    table = TARGETS["cartpole"].table(document)
    assert "at most 120, which are 40 actions of 3 steps each" in table
    assert "| random play |  |  | 20.0 | 19 | 21 | 1 | 2 |" in table


def test_the_wire_time_of_an_image_is_computed_from_its_bytes() -> None:
    table = TARGETS["latency"].table(made("latency"))
    assert "| server behind 10 Mbit/s (computed) | + 16.93 |" in table  # 21168 x 8 bits


def test_robustness_has_a_line_for_each_level_and_a_column_for_each_training() -> None:
    table = TARGETS["robustness"].table(made("robustness"))
    lines = [line for line in table.splitlines() if line.startswith("|")]
    assert "BPN, augmented" in lines[0]
    assert [cell.strip() for cell in lines[-1].strip("|").split("|")] == [
        "noise=25",
        "0",
        "75",
        "0",
        "75",
    ]
    assert "noise=0..30" in table


def test_averaging_has_a_line_for_each_error_and_a_column_for_each_update() -> None:
    lines = [
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in TARGETS["averaging"].table(made("averaging")).splitlines()
        if line.startswith("|")
    ]
    assert lines[0] == ["error added to y", *averaging.UPDATES]
    assert [line[1] for line in lines[2:]] == ["-81.0"] * 5 + ["-95.0 (-100.0 to -90.0)"] * 8
