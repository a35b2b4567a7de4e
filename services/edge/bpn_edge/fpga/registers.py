# ruff: noqa: E501
"""The core's registers: from services/edge/rtl/registers.rdl by services/edge/rtl/generate.py; do not change by hand."""

IDENTITY = 0x000
"""What core this is, and of which layout its registers and weight sets are: the letters BP, then 0x0001."""
BUILD = 0x004
"""What was synthesized."""
BUILD_KEEPS_FRAME = (0, 1)
BUILD_ACTIONS = (8, 8)
BUILD_CHANNELS = (16, 8)
BUILD_PIXEL_BYTES = (24, 8)
LIMITS = 0x008
"""What was synthesized, further."""
LIMITS_NODES = (0, 16)
STATUS = 0x00C
"""What is going on."""
STATUS_VALID = (0, 2)
STATUS_SELECTED = (2, 2)
STATUS_LOADING = (4, 1)
STATUS_IN_FLIGHT = (5, 1)
SELECT = 0x010
"""The bank that the next frames begin with: 1, 2, or 0 for none, so that no frame begins. Refused for a bank that is not verified. Whatever is written, frames before count for nothing to frames after: where two are stacked, the first frame has no result."""
EVENTS = 0x014
"""What has happened; writing 1 to a bit clears it."""
EVENTS_RESULT = (0, 1)
EVENTS_VERIFIED = (1, 1)
EVENTS_MISALIGNED = (2, 1)
EVENTS_SET_IDENTITY = (3, 1)
EVENTS_SET_SIZES = (4, 1)
EVENTS_SET_LENGTH = (5, 1)
EVENTS_SET_CRC = (6, 1)
INTERRUPT = 0x018
"""Which events raise the interrupt."""
FRAMES = 0x01C
"""Results since reset; unchanged before and after reading outputs, they are of one frame."""
RESULT_EPOCH = 0x020
"""Of the weight set that the newest result is from."""
RESULT_SIZES = 0x024
"""Of the network that the newest result is from."""
RESULT_SIZES_CHANNELS = (0, 5)
RESULT_SIZES_ACTIONS = (8, 7)
RESULT_SIZES_NODES = (16, 11)
CLOCKS = 0x028
"""From the newest result's first pixels to it."""
TAIL = 0x02C
"""Clocks from the newest result's last pixels to it."""
BANK_EPOCH = 0x030
"""As the set in the bank says."""
BANK_CRC = 0x038
"""CRC-32 of the set in the bank."""
BANK_SIZES = 0x040
"""Of the network in the bank."""
BANK_SIZES_CHANNELS = (0, 5)
BANK_SIZES_ACTIONS = (8, 7)
BANK_SIZES_NODES = (16, 11)
READ_ADDRESS = 0x050
"""Where Read data reads next."""
READ_ADDRESS_WORD = (0, 27)
READ_ADDRESS_BANK = (27, 1)
READ_ADDRESS_REGION = (28, 4)
READ_DATA = 0x054
"""A word of the memories; the address goes on by one. Refused while a set is being loaded."""
PIXELS = 0x060
"""Pushes a word into the stream of pixels (builds of 4 bytes a clock). Refused while the word before is not taken."""
PIXELS_LAST = 0x064
"""The same, with TLAST."""
WEIGHTS = 0x068
"""Pushes a word into the stream of weights. Refused while the word before is not taken."""
WEIGHTS_LAST = 0x06C
"""The same, with TLAST."""
OUTPUTS = 0x100
"""The true sums of the newest result, signed; one register an action."""

OFFSETS = {
    "IDENTITY": IDENTITY,
    "BUILD": BUILD,
    "LIMITS": LIMITS,
    "STATUS": STATUS,
    "SELECT": SELECT,
    "EVENTS": EVENTS,
    "INTERRUPT": INTERRUPT,
    "FRAMES": FRAMES,
    "RESULT_EPOCH": RESULT_EPOCH,
    "RESULT_SIZES": RESULT_SIZES,
    "CLOCKS": CLOCKS,
    "TAIL": TAIL,
    "BANK_EPOCH": BANK_EPOCH,
    "BANK_CRC": BANK_CRC,
    "BANK_SIZES": BANK_SIZES,
    "READ_ADDRESS": READ_ADDRESS,
    "READ_DATA": READ_DATA,
    "PIXELS": PIXELS,
    "PIXELS_LAST": PIXELS_LAST,
    "WEIGHTS": WEIGHTS,
    "WEIGHTS_LAST": WEIGHTS_LAST,
    "OUTPUTS": OUTPUTS,
}
"""Of every register, in bytes."""
