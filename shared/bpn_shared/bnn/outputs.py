"""What a policy's network says to an observation."""

import numpy as np
import numpy.typing as npt

Outputs = npt.NDArray[np.int32 | np.float32]
"""[|A|], or [T, |A|] of an episode; P = scale * outputs.

int32: o of a binarized network, whose scale is lambda. float32: P itself of a float network, whose scale is 1.
"""
