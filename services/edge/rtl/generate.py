"""Writes what is made from registers.rdl: the driver's constants, docs/fpga-registers.md, and bpn.sv.

Usage: python services/edge/rtl/generate.py [--check]; the latter changes nothing, and fails if one is not current.
"""

import importlib
import subprocess
import sys
from pathlib import Path

from systemrdl import RDLCompiler
from systemrdl.node import AddrmapNode, FieldNode, RegNode

from bpn_edge.fpga import registers as driver_constants
from bpn_edge.fpga.build import Build
from bpn_edge.fpga.package import render

HERE = Path(__file__).parent
ROOT = HERE.parents[2]
NOTE = (
    "from services/edge/rtl/registers.rdl by services/edge/rtl/generate.py; do not change by hand"
)


def registers() -> list[RegNode]:
    compiler = RDLCompiler()
    compiler.compile_file(str(HERE / "registers.rdl"))
    top = compiler.elaborate().top
    assert isinstance(top, AddrmapNode)
    return [node for node in top.children() if isinstance(node, RegNode)]


def constants(hidden_units: list[RegNode]) -> str:
    """The driver's module."""
    lines = ["# ruff: noqa: E501", f'"""The core\'s registers: {NOTE}."""', ""]
    for node in hidden_units:
        lines.append(f"{node.inst_name} = 0x{node.raw_address_offset:03X}")
        lines += [f'"""{node.get_property("desc")}"""']
        for field in _named(node):
            lines.append(
                f"{node.inst_name}_{field.inst_name.upper()} = ({field.low}, {field.width})"
            )
    offsets = ", ".join(f'"{node.inst_name}": {node.inst_name}' for node in hidden_units)
    lines += ["", f"OFFSETS = {{{offsets}}}", '"""Of every register, in bytes."""', ""]
    command = [sys.executable, "-m", "ruff", "format", "--stdin-filename", "registers.py", "-"]
    done = subprocess.run(  # noqa: S603 - ours
        command, input="\n".join(lines), capture_output=True, text=True, check=True
    )
    return done.stdout


def table(hidden_units: list[RegNode]) -> str:
    """The page."""
    lines = [
        "# Registers of the core",
        "",
        f"Written {NOTE}. Offsets in bytes, registers of 32 bits.",
        "",
    ]
    lines += ["| offset | register | access | what |", "|---|---|---|---|"]
    for node in hidden_units:
        count = f"[{node.array_dimensions[0]}]" if node.array_dimensions else ""
        fields = "".join(
            f"<br>{_bits(field)} `{field.inst_name}`: {field.get_property('desc')}"
            for field in _named(node)
        )
        access = "/".join(sorted({_access(field) for field in node.fields()}))
        lines.append(
            f"| 0x{node.raw_address_offset:03X} | `{node.inst_name}`{count} | {access} | "
            f"{node.get_property('desc')}{fields} |"
        )
    return "\n".join((*lines, ""))


def _named(node: RegNode) -> list[FieldNode]:
    """The fields that have something to say; of a register of one field the register says it."""
    return [field for field in node.fields() if field.get_property("desc")]


def _bits(field: FieldNode) -> str:
    return f"{field.high}" if field.width == 1 else f"{field.high}:{field.low}"


def _access(field: FieldNode) -> str:
    return "rw1c" if field.get_property("onwrite") else str(field.get_property("sw").name)


def main() -> int:
    hidden_units = registers()
    generated = {
        HERE.parent / "bpn_edge/fpga/registers.py": constants(hidden_units),
        ROOT / "docs/fpga-registers.md": table(hidden_units),
    }
    check = "--check" in sys.argv
    for path, text in generated.items():
        if check and path.read_text() != text:
            print(
                f"{path.relative_to(ROOT)} is not current: run {Path(__file__).relative_to(ROOT)}"
            )
            return 1
        if not check:
            path.write_text(text)
    importlib.reload(driver_constants)
    package = HERE / "bpn.sv"
    if check:
        return int(package.read_text() != render(Build()))
    package.write_text(render(Build()))
    return 0


if __name__ == "__main__":
    sys.exit(main())
