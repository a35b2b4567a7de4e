"""The ULX3S with an ECP5-85F, speed grade 6."""

from bpn.fpga.board import Board
from bpn.fpga.synthesis import ECP5_85F
from bpn_edge.fpga.build import Build

BITSTREAM = "bpn-ulx3s-85f.bit"
ULX3S = Board(
    target="ulx3s-85f",
    folder="ulx3s",
    pins="ulx3s.lpf",
    build=Build(),
    clock_mhz=120,
    pll=lambda mhz: ("ecppll", ["-i", "25", "-o", str(mhz), "-n", "bpn_pll", "-f", "bpn_pll.v"]),
    synthesis="synth_ecp5",
    place_and_route="nextpnr-ecp5",
    route=lambda pins, seed: [
        *("--85k", "--speed", "6", "--package", "CABGA381"),
        *("--lpf", str(pins), "--textcfg", f"{seed}/routed.config"),
    ],
    pack=lambda seed: ("ecppack", ["--compress", f"{seed}/routed.config", BITSTREAM]),
    bitstream=BITSTREAM,
    clock="clk",
    cells={"LUT": "TRELLIS_COMB", "FF": "TRELLIS_FF", "BRAM18": "DP16KD", "DSP": "MULT18X18D"},
    has=ECP5_85F,
)
