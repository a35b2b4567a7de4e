"""`bpn fpga`: what it says of wrong input, and what it writes and measures without place-and-route."""

import json
import re
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

from bpn.cli import main
from bpn.fpga import clocks, tools, zu3eg
from bpn.fpga.synthesis import Cells
from bpn.fpga.ulx3s import routed
from bpn_edge.fpga import sources
from bpn_edge.fpga.build import Build
from bpn_shared.spec.network import NetworkSpec

SPIRIT = "{http://www.spiritconsortium.org/XMLSchema/SPIRIT/1685-2009}"


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["build", "--target", "ulx3s-85f", "--clock", "100"], "--clock 100: a multiple of 3"),
        (
            ["build", "--target", "zu3eg", "--nodes", "2000"],
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
    found = routed(report)
    assert found["fmax_mhz"] == 121.3
    assert found["share"] == {"LUT": 0.1, "BRAM18": 0.183}


@pytest.mark.parametrize(
    ("spec", "tail"), [(NetworkSpec(6, 100, 17), 400), (NetworkSpec(3, 40, 5), 400)], ids=str
)
def test_measured_clocks_are_as_the_formula_says(spec: NetworkSpec, tail: int) -> None:
    build = Build()
    by_layer, measured = clocks.by_layer(build, spec), clocks.measure(build, spec)
    assert measured.frame == by_layer["conv1"] + measured.tail
    assert measured.tail <= tail
    assert by_layer["conv1"] <= measured.interval <= 1.02 * by_layer["conv1"]
