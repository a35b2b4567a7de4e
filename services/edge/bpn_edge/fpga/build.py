"""What is fixed when the core is synthesized; any network up to these sizes runs without a new synthesis."""

from dataclasses import dataclass

from bpn_shared.spec.network import (
    IMAGE_SIZE_PX,
    MAX_ACTIONS,
    MAX_CHANNELS,
    MAX_HIDDEN_UNITS,
    PAPER_CONVOLUTIONS,
    NetworkSpec,
)

LANES = 16
"""Outputs, and inputs, of the XNOR engine in one clock."""
BLOCK_PX = 4
"""A block of pixels is as wide as conv1's stride."""


@dataclass(frozen=True)
class Build:
    """Parameters of a synthesis.

    Args:
        pixel_bytes: bytes of pixels that conv1 takes in one clock: 1, 2, 4, 8 or 16.
        channels: the largest C.
        hidden_units: the largest N.
        actions: the largest |A|.
        keeps_frame: whether it keeps what a frame is to the next one, so that of two stacked frames only
            the newer one is sent; it makes conv1 twice as large.

    Raises:
        ValueError: one is outside its range.
    """

    pixel_bytes: int = 4
    channels: int = MAX_CHANNELS
    hidden_units: int = 256
    actions: int = MAX_ACTIONS
    keeps_frame: bool = False

    def __post_init__(self) -> None:
        if self.pixel_bytes not in {1, 2, 4, 8, 16}:
            raise ValueError(f"pixel_bytes = {self.pixel_bytes} must be 1, 2, 4, 8 or 16")
        for name, most in (
            ("channels", MAX_CHANNELS),
            ("hidden_units", MAX_HIDDEN_UNITS - 1),
            ("actions", MAX_ACTIONS),
        ):
            if not 2 <= getattr(self, name) <= most:
                raise ValueError(f"{name} = {getattr(self, name)} must be in 2..{most}")

    def frames(self, channels: int) -> int:
        """Of how many frames, stacked to C channels, one is sent: 2 where it keeps the earlier one."""
        return 2 if self.keeps_frame and channels % 2 == 0 else 1

    def beats(self, channels: int) -> int:
        """Clocks that a block of 4 pixels takes, of the frame that is sent for an observation of C channels."""
        return -(-BLOCK_PX * (channels // self.frames(channels)) // self.pixel_bytes)

    @property
    def conv1_lanes(self) -> int:
        """Words of 32 bits in one of conv1's weight memory."""
        return self.pixel_bytes * (2 if self.keeps_frame else 1)

    @property
    def beat_bits(self) -> int:
        """Of the number of a beat in its block."""
        return max(1, (-(-BLOCK_PX * self.channels // self.pixel_bytes) - 1).bit_length())

    def why_not(self, spec: NetworkSpec) -> str | None:
        """Why a network does not run on this build; None: it does."""
        if spec.convolutions != PAPER_CONVOLUTIONS or spec.image_px != IMAGE_SIZE_PX:
            return f"the core runs the paper's convolutions over {IMAGE_SIZE_PX} px, not {spec}"
        for name, size, most in (
            ("C", spec.channels, self.channels),
            ("N", spec.hidden_units, self.hidden_units),
            ("|A|", spec.actions, self.actions),
        ):
            if size > most:
                return f"{name} = {size} is more than the {most} that the core was built for"
        return None


def groups(outputs: int) -> int:
    """Groups of 16 that the engine computes together."""
    return -(-outputs // LANES)


def engine_words(node_groups: int, action_groups: int) -> int:
    """Words of 256 bits in the engine's weight memory."""
    return FC1_WORD + 50 * node_groups + action_groups * node_groups


CONV3_WORD = 1 + 8
"""Where conv3's words begin: after conv2's biases and its 8 words of 16 inputs."""
FC1_WORD = CONV3_WORD + 1 + 9
"""Where FC(N)'s words begin: biases of every group, then 49 inputs of every group."""
