"""Documents to figures and tables, with results made by hand."""

import json
from pathlib import Path
from typing import Any

import pytest

from bpn.cli import main
from bpn.reproduce import computers, heatmap, report
from bpn.reproduce.latency import DELAYS_MS
from bpn.reproduce.targets import TARGETS

SEEDS, ITERATIONS = 3, 12


def record(
    algorithm: str, nodes: int, seed: int, *, alpha: float = 0.95, lost: int = 0
) -> dict[str, Any]:
    return {
        "run_id": f"{algorithm}-{nodes}-{seed}", "task": "tracking", "algorithm": algorithm,
        "nodes": nodes, "alpha": alpha, "seed": seed, "steps": 40, "episodes": 10,
        "returns_px": [-800.0 + 10 * seed - i for i in range(ITERATIONS)],
        "lengths": [40.0 - lost] * ITERATIONS, "failures": [lost] * ITERATIONS,
        "seconds": 60.0, "weights_sha256": "00",
    }  # fmt: skip


def trials(**names: Any) -> dict[str, Any]:
    return names | {
        "trials": 2, "return_px": {"mean": -200.0, "std": 1.0}, "px_per_step": {"mean": -2.5, "std": 0.1},
        "length": {"mean": 80.0, "std": 0.0}, "tracking_time": {"steps": 80, "seconds": 11.6, "percent": 100.0},
        "success_share": 0.5, "deadline_misses": 3, "successes": [True, False], "lengths": [80, 80],
        "gaze_deg": [[[0.0, 0.0], [2.0, 2.0]]],
    }  # fmt: skip


def learning() -> tuple[list[dict[str, Any]], dict[str, Any]]:
    runs = [
        record(algorithm, nodes, seed, lost=2 if algorithm == "bqn" else 0)
        for seed in range(SEEDS)
        for algorithm, nodes in [("bpn", 32), ("bpn", 100), ("bqn", 32), ("bqn", 100), ("cvi", 100)]
    ]
    lines = [{"name": "optimum", "return_px": -770.0, "length": 40, "full_length_share": 1.0}]
    return runs, {"references": lines}


def times(total_us: float) -> dict[str, Any]:
    part = {"p50": total_us, "p99": 2 * total_us}
    return dict.fromkeys(("send_us", "compute_us", "receive_us", "total_us"), part)


RESULTS: dict[str, tuple[list[dict[str, Any]], dict[str, Any]]] = {
    "reaching": learning(),
    "tracking": learning(),
    "heatmap": (
        [record("bpn", n, s, alpha=a) for s in range(SEEDS) for n in (16, 32) for a in (0.0, 0.95)],
        {},
    ),
    "pan-tilt": (
        [record(algorithm, 100, seed) for seed in range(SEEDS) for algorithm in ("bpn", "bqn")],
        {
            "trials": [
                trials(name="random", seed=0),
                *(trials(name="bpn", seed=seed) for seed in range(SEEDS)),
                trials(name="bqn", seed=0),
            ]
        },
    ),
    "inference": (
        [],
        {
            "network": "C=6",
            "candidates": {
                "native avx2": {"p50_us": 8.0, "p99_us": 9.0},
                "golden": {"p50_us": 800.0, "p99_us": 900.0},
            },
        },
    ),
    "latency": (
        [record("bpn", 100, seed) for seed in range(SEEDS)],
        {
            "computers": {computers.EDGE: times(40.0), computers.SERVER: times(800.0)},
            "image_bytes": 21168,
            "camera_to_action_us": {"p50": 500.0, "p99": 900.0},
            "trials": [
                trials(algorithm="bpn", seed=seed, delay_ms=delay_ms)
                for seed in range(SEEDS)
                for delay_ms in DELAYS_MS
            ],
        },
    ),
}

RESULTS["cartpole"] = (
    [
        {k: v for k, v in record("bpn", 128, seed).items() if k != "returns_px"}
        | {"returns": [20.0 + i for i in range(ITERATIONS)]}
        for seed in range(SEEDS)
    ],
    {
        "trials": [
            {
                "name": name, "seed": seed, "trials": 2, "return": {"mean": 20.0, "std": 1.0},
                "returns": [19.0, 21.0],
            }
            for name, seed in (("random", 0), *(("bpn", seed) for seed in range(SEEDS)))
        ]
    },
)  # fmt: skip


def made(name: str, *, quick: bool = False) -> dict[str, Any]:
    runs, result = RESULTS[name]
    document = report.document(TARGETS[name], f"bpn reproduce {name}", [], result, quick=quick)
    return document | {"runs": runs}


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
    assert "quick version" not in page
    assert "quick version" in report.page(TARGETS[name], made(name, quick=True))


@pytest.mark.parametrize("name", TARGETS)
def test_every_row_of_a_table_has_as_many_cells_as_its_heading(name: str) -> None:
    for table in TARGETS[name].table(made(name)).split("\n\n"):
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
    assert "80.0 %" in bqn  # of the episodes kept the target
    assert "38.0" in bqn  # steps
    assert "-796.5 ± 10.0" in bqn  # mean of the last ten of -800 + 10 seed - i, over seeds 0, 1, 2
    assert "+0.0 %" in bqn  # as float CVI returns
    assert "n = 3" in _legend("tracking")


def repeated(name: str, times: int = 4) -> dict[str, Any]:
    """The first seed alone, made several times."""
    document = made(name)
    trials = [one for one in document["result"].get("trials", []) if one["seed"] == 0]
    document["runs"] = [run for run in document["runs"] if run["seed"] == 0] * times
    return document | {"result": document["result"] | {"trials": trials}}


@pytest.mark.parametrize("name", ["reaching", "tracking", "heatmap", "pan-tilt", "latency"])
def test_one_seed_has_no_spread_and_its_repetitions_are_no_seeds(name: str) -> None:
    document = repeated(name)
    table = TARGETS[name].table(document)
    assert "± 0" not in table
    assert "± -" in table
    TARGETS[name].draw(document)
    if name in ("reaching", "tracking", "heatmap"):
        assert "| 1 (4 runs) |" in table


RESULTS_DIR = Path(__file__).parents[3] / "docs" / "results"


@pytest.mark.parametrize("name", TARGETS)
def test_the_published_page_is_what_its_results_give(name: str, tmp_path: Path) -> None:
    """If not: bpn reproduce TARGET --redraw"""
    document = report.read(TARGETS[name], RESULTS_DIR)
    assert (RESULTS_DIR / f"{name}.md").read_text() == report.page(TARGETS[name], document)
    (tmp_path / f"{name}.json").write_bytes((RESULTS_DIR / f"{name}.json").read_bytes())
    assert main(["reproduce", name, "--redraw", "--out", str(tmp_path)]) == 0
    assert (tmp_path / f"{name}.md").read_text() == (RESULTS_DIR / f"{name}.md").read_text()
    assert (tmp_path / f"{name}.png").stat().st_size > 0


def test_without_results_there_is_nothing_to_redraw(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["reproduce", "heatmap", "--redraw", "--out", str(tmp_path)]) == 2
    assert "heatmap.json" in capsys.readouterr().err


def _legend(name: str) -> str:
    figure = TARGETS[name].draw(made(name))
    return " ".join(text.get_text() for legend in figure.legends for text in legend.get_texts())


def test_learning_figures_have_a_column_for_every_n_and_lengths_only_where_episodes_end_early() -> (
    None
):
    assert len(TARGETS["tracking"].draw(made("tracking")).axes) == 2 * 2
    never_lost = made("reaching")
    never_lost["runs"] = [run | {"failures": [0] * ITERATIONS} for run in never_lost["runs"]]
    assert len(TARGETS["reaching"].draw(never_lost).axes) == 2


def test_a_heat_map_cell_holds_the_mean_and_the_spread_of_its_seeds() -> None:
    cells = heatmap.cells(made("heatmap"))
    assert [(cell["nodes"], cell["alpha"]) for cell in cells] == [
        (16, 0),
        (16, 0.95),
        (32, 0),
        (32, 0.95),
    ]
    assert cells[0]["best_return_px"]["mean"] == pytest.approx(-790)  # of -800, -790, -780
    assert cells[0]["best_return_px"]["std"] == pytest.approx(10)
    assert cells[0]["seeds"] == "3"


def test_the_tracking_time_table_pools_trials_and_shows_every_seed() -> None:
    row = next(
        line for line in TARGETS["pan-tilt"].table(made("pan-tilt")).splitlines() if "| BPN" in line
    )
    assert "3/6 (1/2, 1/2, 1/2)" in row
    assert "11.6 ± 0.0 (100)" in row


def test_the_wire_time_of_an_image_is_computed_from_its_bytes() -> None:
    table = TARGETS["latency"].table(made("latency"))
    assert "| server behind 10 Mbit/s (computed) | + 16.93 |" in table  # 21168 x 8 bits
