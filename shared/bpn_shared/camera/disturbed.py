"""Pictures of one episode as a disturbed camera would give them: bytes in, bytes out.

What is drawn is a pure function of the episode's seed and the step: whoever plays the episode again sees the same.
"""

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from bpn_shared.camera.jpeg import compressed
from bpn_shared.spec.disturbances import KINDS, Range, drawn
from bpn_shared.spec.network import MAX_PIXEL
from bpn_shared.spec.seeds import disturbance_uniforms, pixel_generator

Picture = npt.NDArray[np.uint8]
Floats = npt.NDArray[np.float32]

_BLUR_REACH = 3.0
"""Standard deviations after which a blur's weights end."""


class EpisodeCamera:
    """A camera during one episode.

    Args:
        levels: of `KINDS`; the ones that concern no pictures change none.
        seed: the episode's.
    """

    def __init__(self, levels: Mapping[str, Range], seed: int) -> None:
        self._seed = seed
        self._levels = drawn(levels, seed)
        balance = disturbance_uniforms(seed, len(KINDS))[KINDS["white_balance"].number, 1:]
        self._balance = 1 + self._levels.get("white_balance", 0.0) * (2 * balance - 1)

    @property
    def levels(self) -> dict[str, float]:
        """What this episode drew, by kind."""
        return dict(self._levels)

    def picture(self, frame: Picture, step: int) -> Picture:
        """The frame of a step as the camera gives it.

        The light comes first, then the lens, the sensor, and the compression of what it tells.

        Args:
            frame: uint8[c, h, w].
            step: 0 at the reset.

        Returns:
            uint8[c, h, w]; the frame itself where nothing disturbs it.
        """
        on = self._levels.keys() & _PICTURED
        if not on:
            return frame
        random = pixel_generator(self._seed, step)
        exposure = self._levels.get("exposure", 0.0) * (2 * random.random() - 1)
        factors = np.full(len(frame), self._levels.get("gain", 1.0) * (1 + exposure))
        if len(frame) == 3:
            factors *= self._balance
        seen = frame * factors.astype(np.float32)[:, None, None]
        if self._levels.get("blur"):
            seen = blurred(seen, self._levels["blur"])
        if self._levels.get("noise"):
            noise = random.standard_normal(seen.shape, np.float32)
            seen += np.float32(self._levels["noise"]) * noise
        seen += np.float32(self._levels.get("offset", 0.0))
        told = np.clip(np.rint(seen), 0, MAX_PIXEL).astype(np.uint8)
        if "salt_pepper" in self._levels:
            draws = random.random(frame.shape[1:], np.float32)
            share = self._levels["salt_pepper"]
            told[:, draws < share] = 0
            told[:, draws < share / 2] = MAX_PIXEL
        return compressed(told, round(self._levels["jpeg"])) if "jpeg" in self._levels else told


_PICTURED = {name for name, kind in KINDS.items() if kind.scope == "picture"}


def blurred(planes: Floats, sigma_px: float) -> Floats:
    """Each plane float32[c, h, w] under a Gaussian blur; beyond the border is what the border shows."""
    reach = max(1, round(_BLUR_REACH * sigma_px))
    weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma_px) ** 2)
    weights = (weights / weights.sum()).astype(np.float32)
    for axis in (1, 2):
        pads = [(0, 0), (0, 0), (0, 0)]
        pads[axis] = (reach, reach)
        windows = np.lib.stride_tricks.sliding_window_view(
            np.pad(planes, pads, "edge"), 2 * reach + 1, axis
        )
        planes = windows @ weights
    return planes
