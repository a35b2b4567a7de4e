from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

def available_paths() -> list[str]: ...

class Network:
    def __init__(
        self,
        path: str,
        any_shape: bool,
        layers: Sequence[tuple[int, int, int, int, int]],
        weights: Sequence[npt.NDArray[np.int8]],
        thresholds: Sequence[npt.NDArray[np.int32]],
        /,
    ) -> None: ...
    def run(self, observation: npt.NDArray[np.uint8], /) -> npt.NDArray[np.int32]: ...
    def read_back(
        self,
    ) -> tuple[list[npt.NDArray[np.int8]], list[npt.NDArray[np.int32]]]: ...
    def checksum(self) -> int: ...
    def memory(self) -> npt.NDArray[np.uint8]: ...
    def trace(
        self, observation: npt.NDArray[np.uint8], /
    ) -> tuple[tuple[npt.NDArray[np.uint8], ...], npt.NDArray[np.int32]]: ...
