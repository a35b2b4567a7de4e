"""bpn.sv: the SystemVerilog package of a build, with the network's geometry, widths and the registers' offsets."""

from bpn_edge.fpga import registers
from bpn_edge.fpga.build import BLOCK_PX, CONV3_WORD, FC1_WORD, Build, engine_words, groups
from bpn_shared.spec.network import IMAGE_SIZE_PX, MAX_PIXEL, NetworkSpec

IDENTITY = 0x4250_0001
"""Letters BP, and the number of the layout of registers and weight sets."""
SET_IDENTITY = 0x4257_0000
"""First word of a weight set: letters BW, the layout's number, bytes of pixels a clock."""
LAYOUT = 1
EVENTS = 7


def set_identity(build: Build) -> int:
    """The first word of the sets that a build takes."""
    return SET_IDENTITY | LAYOUT << 8 | build.pixel_bytes


def render(build: Build) -> str:
    """The package's text."""
    conv1, conv2, conv3, _, _ = NetworkSpec(
        build.channels, build.hidden_units, build.actions
    ).layers
    node_groups, action_groups = groups(build.hidden_units), groups(build.actions)
    group_w, action_group_w = node_groups.bit_length() + (node_groups == 1), 3
    beat_w = build.beat_bits
    most_matches = max(conv3.out_size**2 * conv3.out_channels + 1, build.hidden_units)
    g_actions = 5
    g_nodes = g_actions + 7
    g_action_groups = g_nodes + 11
    g_node_groups = g_action_groups + action_group_w
    g_stacked = g_node_groups + group_w
    g_last_beat = g_stacked + 1
    numbers = {
        "The build": {
            "BYTES": build.pixel_bytes,
            "CONV1_LANES": build.conv1_lanes,
            "MAX_CHANNELS": build.channels,
            "MAX_HIDDEN_UNITS": build.hidden_units,
            "MAX_ACTIONS": build.actions,
        },
        "Geometry": {
            "IMAGE": IMAGE_SIZE_PX,
            "BLOCKS": IMAGE_SIZE_PX // BLOCK_PX,
            "CONV1_WORDS": conv1.out_size**2 // 2,
            "CONV3_WEIGHTS": CONV3_WORD,
            "FC1_WEIGHTS": FC1_WORD,
        },
        "Widths, of counters and sums": {
            "PAIRS": max(1, build.pixel_bytes // 2),
            "BEAT_W": beat_w,
            "BLOCK_W": 5,
            "ROW_W": 7,
            "TREE": max(1, (build.pixel_bytes - 1).bit_length()),
            "BEAT_SUM_W": 8 + (build.pixel_bytes - 1).bit_length(),
            "ROW_SUM_W": (conv1.kernel * build.channels * MAX_PIXEL).bit_length(),
            "SUM_W": conv1.max_output.bit_length(),
            "EARLIER_W": (conv1.max_output // 2).bit_length() + 1,
            "TAU_W": (conv1.max_output + 1).bit_length() + 1,
            "GROUP_W": group_w,
            "ACTION_GROUP_W": action_group_w,
            "KEPT_W": max(1, (node_groups - 1).bit_length()),
            "WEIGHT_W": (engine_words(node_groups, action_groups) - 1).bit_length(),
            "ACC_W": most_matches.bit_length() + 1,
        },
        "Fields of what is kept of a network's sizes": {
            "G_CHANNELS": 0,
            "G_ACTIONS": g_actions,
            "G_NODES": g_nodes,
            "G_ACTION_GROUPS": g_action_groups,
            "G_NODE_GROUPS": g_node_groups,
            "G_STACKED": g_stacked,
            "G_LAST_BEAT": g_last_beat,
            "GEOMETRY_W": g_last_beat + beat_w,
            "EVENTS": EVENTS,
        },
    }
    assert conv2.out_size**2 <= 128
    lines = [
        "// Written by bpn_edge.fpga.package for a build; registers from registers.rdl.",
        "package bpn;",
    ]
    for comment, values in numbers.items():
        lines.append(f"  // {comment}.")
        lines += [f"  localparam int {name} = {value};" for name, value in values.items()]
    lines.append("  // Identities, and registers by number.")
    lines.append(f"  localparam logic [31:0] IDENTITY = 32'h{IDENTITY:08x};")
    lines.append(f"  localparam logic [31:0] SET_IDENTITY = 32'h{set_identity(build):08x};")
    lines += [
        f"  localparam logic [7:0] R_{name} = 8'h{offset // 4:02x};"
        for name, offset in registers.OFFSETS.items()
    ]
    return "\n".join((*lines, "endpackage", ""))
