"""The episodes of D as a disturbed camera would have seen them, for P to be fitted to the same targets there too.

Targets, rewards and play are those of the pictures that the robot saw. Each update shows the network the same
values under other light and noise.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from bpn_learner.transitions import EpisodeData
from bpn_shared.camera.disturbed import EpisodeCamera
from bpn_shared.spec.disturbances import Range
from bpn_shared.spec.seeds import augmentation_seed


def seen_again(
    episodes: Sequence[EpisodeData], levels: Mapping[str, Range], run_seed: int, iteration: int
) -> list[EpisodeData]:
    """D's episodes with pictures that an update disturbs anew; each draws its own levels."""
    cameras = [
        EpisodeCamera(levels, augmentation_seed(run_seed, iteration, index))
        for index in range(len(episodes))
    ]
    return [
        replace(
            one, frames=np.stack([camera.picture(frame, t) for t, frame in enumerate(one.frames)])
        )
        for one, camera in zip(episodes, cameras, strict=True)
    ]
