"""The core as IP for Vivado, for an Ultra96-V2 (xczu3eg) or another part, and yosys's estimate of it."""

import json
import shutil
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

from bpn.fpga import tools
from bpn.fpga.synthesis import ZU3EG, estimate_xilinx, write_sources
from bpn_edge.fpga import sources
from bpn_edge.fpga.build import Build

_SPIRIT = "http://www.spiritconsortium.org/XMLSchema/SPIRIT/1685-2009"
_STREAM = ("TDATA", "TVALID", "TREADY", "TLAST")
_LITE = (
    *(
        "AWADDR",
        "AWVALID",
        "AWREADY",
        "WDATA",
        "WSTRB",
        "WVALID",
        "WREADY",
        "BRESP",
        "BVALID",
        "BREADY",
    ),
    *("ARADDR", "ARVALID", "ARREADY", "RDATA", "RRESP", "RVALID", "RREADY"),
)
INTERFACES = {
    "s_axi": ("xilinx.com", "interface", "aximm", _LITE),
    "s_axis_pixels": ("xilinx.com", "interface", "axis", _STREAM),
    "s_axis_weights": ("xilinx.com", "interface", "axis", _STREAM),
}


def make(build: Build, where: Path) -> dict[str, Any]:
    """Writes the IP's folder, and estimates.

    Returns:
        What yosys estimates, and of what share of an xczu3eg.

    Raises:
        MissingToolError, CommandError: yosys is not installed, or fails.
    """
    ip = where / "ip"
    ip.mkdir(parents=True, exist_ok=True)
    files = write_sources(build, ip)
    for path in (sources.folder() / "boards/ultra96").iterdir():
        shutil.copy(path, ip)
    (ip / "component.xml").write_bytes(component([*files, "bpn_ip.v"], build))
    synthesis = where / "yosys"
    synthesis.mkdir(exist_ok=True)
    used = estimate_xilinx(build, synthesis)
    figures = {
        "target": "zu3eg",
        "estimate": used,
        "share": {name: round(count / ZU3EG[name], 3) for name, count in used.items()},
        "tools": [tools.version("yosys")],
    }
    (where / "figures.json").write_text(json.dumps(figures, indent=1) + "\n")
    return figures


def component(files: list[str], build: Build) -> bytes:
    """component.xml (IP-XACT): the bus interfaces over the ports of bpn_ip.v, and the sources."""
    ET.register_namespace("spirit", _SPIRIT)
    root = _element(None, "component")
    for name, value in (
        ("vendor", "bpn"),
        ("library", "user"),
        ("name", "bpn"),
        ("version", "1.0"),
    ):
        _element(root, name, value)
    interfaces = _element(root, "busInterfaces")
    for prefix, (vendor, library, name, signals) in INTERFACES.items():
        _bus(
            interfaces,
            prefix,
            f"{vendor}:{library}:{name}",
            {signal: f"{prefix}_{signal.lower()}" for signal in signals},
        )
    _bus(interfaces, "aclk", "xilinx.com:signal:clock", {"CLK": "aclk"})
    _bus(interfaces, "aresetn", "xilinx.com:signal:reset", {"RST": "aresetn"})
    _bus(interfaces, "irq", "xilinx.com:signal:interrupt", {"INTERRUPT": "irq"}, master=True)
    model = _element(root, "model")
    view = _element(_element(model, "views"), "view")
    _element(view, "name", "xilinx_anylanguagesynthesis")
    _element(view, "envIdentifier", ":vivado.xilinx.com:synthesis")
    _element(view, "modelName", "bpn_ip")
    _element(_element(view, "fileSetRef"), "localName", "sources")
    file_set = _element(_element(root, "fileSets"), "fileSet")
    _element(file_set, "name", "sources")
    for file in files:
        entry = _element(file_set, "file")
        _element(entry, "name", file)
        _element(
            entry, "fileType", "systemVerilogSource" if file.endswith(".sv") else "verilogSource"
        )
    _element(
        root,
        "description",
        f"Binarized policy, {8 * build.pixel_bytes} bits of pixels a clock, N <= {build.hidden_units}",
    )
    ET.indent(root)
    text: bytes = ET.tostring(root, encoding="UTF-8", xml_declaration=True)
    return text


def _bus(
    parent: ET.Element, name: str, kind: str, ports: dict[str, str], *, master: bool = False
) -> None:
    bus = _element(parent, "busInterface")
    _element(bus, "name", name)
    vendor, library, type_ = kind.split(":")
    for suffix, tag in (("", "busType"), ("_rtl", "abstractionType")):
        attributes = {
            "vendor": vendor,
            "library": library,
            "name": f"{type_}{suffix}",
            "version": "1.0",
        }
        _element(bus, tag).attrib.update(
            {f"{{{_SPIRIT}}}{key}": value for key, value in attributes.items()}
        )
    _element(bus, "master" if master else "slave")
    maps = _element(bus, "portMaps")
    for logical, physical in ports.items():
        port_map = _element(maps, "portMap")
        _element(_element(port_map, "logicalPort"), "name", logical)
        _element(_element(port_map, "physicalPort"), "name", physical)


def _element(parent: ET.Element | None, name: str, text: str | None = None) -> ET.Element:
    tag = f"{{{_SPIRIT}}}{name}"
    element = ET.Element(tag) if parent is None else ET.SubElement(parent, tag)
    element.text = text
    return element
