"""Proves the properties in this folder for all time: bounded from reset, and by induction; needs yosys and z3.

Usage: python services/edge/rtl/formal/prove.py [NAME...]
"""

import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

HERE = Path(__file__).parent
RTL = HERE.parent
SOLVER = "yices" if shutil.which("yices-smt2") else "z3"


@dataclass(frozen=True)
class Property:
    """What is proven of what.

    Attributes:
        modules: that it is of.
        inside: signals inside of them that it looks at, by the name that it gives them.
        clocks: how many the proofs look at.
    """

    modules: tuple[str, ...]
    inside: dict[str, str]
    clocks: int = 8


PROPERTIES = {
    "axi_lite": Property(("bpn_axi_lite.sv",), {}),
    "frame_gate": Property(
        ("bpn_frame_gate.sv",),
        {
            "gate_state": "u_gate.state",
            "gate_held": "u_gate.held",
            "gate_final_beat": "u_gate.final_beat",
        },
    ),
    "banks_and_flight": Property(
        ("bpn_loader.sv", "bpn_banks.sv", "bpn_flight.sv", "formal/any_crc.sv"),
        {"loader_state": "u_loader.state", "flight_count": "u_flight.count"},
    ),
}


def prove(name: str) -> bool:
    of = PROPERTIES[name]
    with tempfile.TemporaryDirectory() as folder:
        model = Path(folder) / "model.smt2"
        files = " ".join(str(RTL / file) for file in ("bpn.sv", *of.modules, f"formal/{name}.sv"))
        connect = "".join(f"connect -set {ours} {theirs}; " for ours, theirs in of.inside.items())
        script = (
            f"read_verilog -sv -formal {files}; hierarchy -top {name}; proc; flatten; {connect}"
            f"opt -full; memory_map; async2sync; dffunmap; opt_clean -purge; write_smt2 -wires {model}"
        )
        subprocess.run([_tool("yosys"), "-q", "-p", script], check=True)  # noqa: S603 - a tool that was found
        for what in ([], ["-i"]):
            began_s = time.monotonic()
            command = [_tool("yosys-smtbmc"), "-s", SOLVER, "-t", str(of.clocks), *what, str(model)]
            done = subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603 - a tool that was found
            passed = done.returncode == 0
            kind = "induction" if what else "from reset"
            print(
                f"{name}: {kind}, {of.clocks} clocks: {'proven' if passed else 'FAILED'} "
                f"({time.monotonic() - began_s:.1f} s)"
            )
            if not passed:
                print(done.stdout[-3000:])
                return False
    return True


def _tool(name: str) -> str:
    beside = Path(sys.executable).parent / f"yowasp-{name}"
    return shutil.which(name) or str(beside)


if __name__ == "__main__":
    sys.exit(not all(prove(name) for name in sys.argv[1:] or PROPERTIES))
