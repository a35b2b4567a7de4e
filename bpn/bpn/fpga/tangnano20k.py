"""The Tang Nano 20K with a Gowin GW2AR-18, for which the core is built smaller."""

from bpn.fpga.board import Board
from bpn.fpga.synthesis import GW2AR_18
from bpn_edge.fpga.build import Build

_DEVICE, _FAMILY = "GW2AR-LV18QN88C8/I7", "GW2A-18C"
BITSTREAM = "bpn-tangnano20k.fs"
TANGNANO20K = Board(
    target="tangnano20k",
    folder="tangnano20k",
    pins="tangnano20k.cst",
    build=Build(channels=6, hidden_units=112, actions=32),
    clock_mhz=54,
    pll=lambda mhz: (
        "gowin_pll",
        ["-d", _DEVICE, "-i", "27", "-o", str(mhz), "-m", "bpn_pll", "-f", "bpn_pll.v"],
    ),
    synthesis="synth_gowin -family gw2a",
    place_and_route="nextpnr-himbaechel-gowin",
    route=lambda pins, seed: [
        *("--device", _DEVICE, "--vopt", f"family={_FAMILY}", "--vopt", f"cst={pins}"),
        *("--write", f"{seed}/routed.json"),
    ],
    pack=lambda seed: ("gowin_pack", ["-d", _FAMILY, "-o", BITSTREAM, f"{seed}/routed.json"]),
    bitstream=BITSTREAM,
    clock="clk",
    cells={"LUT": "LUT4", "ALU": "ALU", "FF": "DFF", "BRAM18": "BSRAM", "DSP": "MULT18X18"},
    has=GW2AR_18,
)
