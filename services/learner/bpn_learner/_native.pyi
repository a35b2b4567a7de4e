from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

def available_paths() -> list[str]: ...

class Kernel:
    def __init__(self, path: str, layers: Sequence[tuple[int, int, int, int, int]], /) -> None: ...
    def gradients(
        self,
        observations: npt.NDArray[np.uint8],
        batch: npt.NDArray[np.int64],
        actions: npt.NDArray[np.int64],
        targets: npt.NDArray[np.float32],
        latent: npt.NDArray[np.float32],
        gamma: npt.NDArray[np.float32],
        beta: npt.NDArray[np.float32],
        log_scale: float,
        latent_gradient: npt.NDArray[np.float32],
        gamma_gradient: npt.NDArray[np.float32],
        beta_gradient: npt.NDArray[np.float32],
        total: int,
        sum_up: Callable[[npt.NDArray[np.float64]], None] | None,
        /,
    ) -> tuple[float, float]: ...

class FloatKernel:
    def __init__(self, path: str, layers: Sequence[tuple[int, int, int, int, int]], /) -> None: ...
    def gradients(
        self,
        observations: npt.NDArray[np.uint8],
        batch: npt.NDArray[np.int64],
        actions: npt.NDArray[np.int64],
        targets: npt.NDArray[np.float32],
        weights: npt.NDArray[np.float32],
        biases: npt.NDArray[np.float32],
        weights_gradient: npt.NDArray[np.float32],
        biases_gradient: npt.NDArray[np.float32],
        total: int,
        /,
    ) -> float: ...
