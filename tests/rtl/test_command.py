"""`bpn fpga`: what it says of wrong input, and what it writes and measures without place-and-route."""

import json
import re
import subprocess
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

from bpn.cli import main
from bpn.commands.fpga import BOARDS
from bpn.fpga import board as board_module
from bpn.fpga import clocks, tools, zu3eg
from bpn.fpga.board import Board, routed
from bpn.fpga.synthesis import Cells
from bpn.fpga.ulx3s import ULX3S
from bpn_edge.fpga import sources
from bpn_edge.fpga.build import Build
from bpn_edge.fpga.verilated import verilator
from bpn_shared.spec.network import NetworkSpec

SPIRIT = "{http://www.spiritconsortium.org/XMLSchema/SPIRIT/1685-2009}"


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["build", "--target", "ulx3s-85f", "--clock", "100"], "--clock 100: a multiple of 3"),
        (
            ["build", "--target", "tangnano20k", "--clock", "24"],
            "--clock 24: a multiple of 3 in 27..300",
        ),
        (["build", "--target", "ulx3s-85f", "--seeds", "0"], "--seeds 0 must be in 1..100"),
        (
            ["build", "--target", "zu3eg", "--hidden-units", "2000"],
            "hidden_units = 2000 must be in 2..1023",
        ),
        (["report", "--network", "6,100"], "--network 6,100: C,N,|A| such as 6,100,17"),
        (["report", "--network", "6,0,17"], "hidden_units = 0 is outside"),
    ],
)
def test_wrong_input_is_one_line(
    arguments: list[str], said: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    assert main(["fpga", *arguments, "--out", str(tmp_path)]) == 2
    assert said in capsys.readouterr().err


def test_a_tool_that_is_missing_is_said_to_be(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(tools.shutil, "which", lambda _: None)
    monkeypatch.setattr(tools.sysconfig, "get_path", lambda _: str(tmp_path))
    with pytest.raises(
        tools.MissingToolError, match=r"yosys is not installed: pip install 'bpn\[fpga\]'"
    ):
        tools.find("yosys")


def test_the_ip_has_every_port_and_source() -> None:
    root = ET.fromstring(zu3eg.component(["bpn.sv", "bpn_ip.v"], Build()))
    mapped = {port.findtext(f"{SPIRIT}name") for port in root.iter(f"{SPIRIT}physicalPort")}
    wrapper = (sources.folder() / "boards/ultra96/bpn_ip.v").read_text()
    ports = set(
        re.findall(r"^\s*(?:input|output) wire (?:\[[^]]+\] )?(\w+)", wrapper, re.MULTILINE)
    )
    assert mapped == ports
    core = (sources.folder() / "bpn_core.sv").read_text().split(");")[0]
    assert ports == set(re.findall(r"(\w+)(?=,?$)", core, re.MULTILINE)) & ports
    assert [file.findtext(f"{SPIRIT}name") for file in root.iter(f"{SPIRIT}file")] == [
        "bpn.sv",
        "bpn_ip.v",
    ]


def test_cells_are_counted_as_the_device_has_them(tmp_path: Path) -> None:
    types = ["LUT6", "LUT2", "RAM32M16", "SRL16E", "FDRE", "RAMB36E2", "RAMB18E2", "CARRY4"]
    cells = {str(number): {"type": kind} for number, kind in enumerate(types)}
    path = tmp_path / "netlist.json"
    path.write_text(json.dumps({"modules": {"top": {"cells": cells}}}))
    assert Cells.read(path, "top").xilinx() == {"LUT": 11, "FF": 1, "BRAM36": 1.5, "DSP": 0}


def test_the_slowest_share_of_the_route_report() -> None:
    report = {
        "fmax": {"$glbnet$clk": {"achieved": 121.26, "constraint": 120.0}},
        "utilization": {
            "TRELLIS_COMB": {"used": 8364, "available": 83640},
            "DP16KD": {"used": 38, "available": 208},
        },
    }
    found = routed(ULX3S, report)
    assert found["fmax_mhz"] == 121.3
    assert found["share"] == {"LUT": 0.1, "BRAM18": 0.183}


@pytest.mark.parametrize("board", BOARDS.values(), ids=BOARDS)
def test_a_board_has_a_pin_for_every_port_of_its_shell(board: Board) -> None:
    folder = sources.folder() / "boards" / board.folder
    shell = (folder / f"bpn_{board.folder}.sv").read_text().split(");")[0]
    ports: set[str] = set()
    for msb, name in re.findall(
        r"^ +(?:in|out)put logic (?:\[(\d+):0\] )?(\w+)", shell, re.MULTILINE
    ):
        ports |= {f"{name}[{bit}]" for bit in range(int(msb) + 1)} if msb else {name}
    pins = re.findall(
        r'^(?:IO_LOC|LOCATE COMP) "([^"]+)"', (folder / board.pins).read_text(), re.MULTILINE
    )
    assert ports == set(pins)
    assert len(pins) == len(ports)
    assert board.clock_mhz % 3 == 0


@pytest.mark.parametrize("board", BOARDS.values(), ids=BOARDS)
def test_verilators_lint_has_nothing_to_say_of_a_shell(board: Board, tmp_path: Path) -> None:
    """With a PLL in place of the vendor's."""
    ports = {"ulx3s": ("clkin", "clkout0"), "tangnano20k": ("clock_in", "clock_out")}[board.folder]
    (tmp_path / "bpn_pll.sv").write_text(
        f"module bpn_pll (input logic {ports[0]}, output logic {ports[1]}, output logic locked);\n"
        f"  assign {ports[1]} = {ports[0]};\n  assign locked = 1'b1;\nendmodule\n"
    )
    program, environment = verilator()
    folder = sources.folder()
    command = [program, "--lint-only", "-Wall", "--top-module", f"bpn_{board.folder}"]
    command += [sources.write_package(board.build, tmp_path), tmp_path / "bpn_pll.sv"]
    command += [*sources.core_files(), *sorted((folder / "serial").glob("*.sv"))]
    command += sorted((folder / "boards" / board.folder).glob("*.sv"))
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert not done.stderr.strip()


def test_the_best_of_several_tries_is_packed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Until one meets the clock; tools that say what they were asked in place of the real ones."""
    rates = {"1": 100.0, "2": 118.0, "3": 110.0, "4": 121.0, "5": 150.0}
    asked: list[list[str]] = []

    def run(name: str, arguments: list[str], *, where: Path, log: str) -> float:  # noqa: ARG001
        asked.append([name, *arguments])
        if name == ULX3S.place_and_route:
            seed = arguments[arguments.index("--seed") + 1]
            report = {"fmax": {"$glbnet$clk": {"achieved": rates[seed]}}, "utilization": {}}
            (where / seed / "route.json").write_text(json.dumps(report))
        if name == "ecppack":
            (where / arguments[-1]).write_bytes(b"12")
        return 1.0

    monkeypatch.setattr(board_module.tools, "run", run)
    monkeypatch.setattr(board_module.tools, "version", lambda name: f"{name} 0")
    for seeds, best, tries in ((1, "1", 1), (3, "2", 3), (5, "4", 4)):
        asked.clear()
        figures = board_module.make(ULX3S, Build(), 120, seeds, tmp_path)
        assert (figures["seed"], figures["fmax_mhz"]) == (int(best), rates[best])
        assert [step[0] for step in asked].count(ULX3S.place_and_route) == tries
        assert f"{best}/routed.config" in asked[-1]


@pytest.mark.parametrize(
    ("spec", "tail"), [(NetworkSpec(6, 100, 17), 400), (NetworkSpec(3, 40, 5), 400)], ids=str
)
def test_measured_clocks_are_as_the_formula_says(spec: NetworkSpec, tail: int) -> None:
    build = Build()
    by_layer, measured = clocks.by_layer(build, spec), clocks.measure(build, spec)
    assert measured.frame == by_layer["conv1"] + measured.tail
    assert measured.tail <= tail
    assert by_layer["conv1"] <= measured.interval <= 1.02 * by_layer["conv1"]
