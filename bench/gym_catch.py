"""Catch as a Gymnasium environment: a ball falls, a paddle of one cell moves left, not or right below it.

The smallest task in which a reward tells of actions that lie several steps back: 10 x 7 cells, 9 actions an
episode, +1 for the ball caught, -1 for one that is not. Whoever plays at random gets about -0.7, the best 1.

    PYTHONPATH=. bpn train gym:bench.gym_catch:Catch-v0 --allow-gym-modules bench.gym_catch
"""

from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt
from gymnasium.spaces import Box, Discrete

ROWS, COLUMNS, CELL_PX = 10, 7, 12
BACKGROUND, BALL, PADDLE = 0, 255, 160

Picture = npt.NDArray[np.uint8]


class Catch(gymnasium.Env[Picture, np.int64]):
    """The game; observations are pictures uint8[120, 84, 1]."""

    observation_space = Box(0, 255, (ROWS * CELL_PX, COLUMNS * CELL_PX, 1), np.uint8)
    action_space = Discrete(3)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Picture, dict[str, Any]]:
        """The ball is in any column of the first row, the paddle in the middle of the last one."""
        super().reset(seed=seed, options=options)
        self._row, self._ball = 0, int(self.np_random.integers(COLUMNS))
        self._paddle = COLUMNS // 2
        return self._seen(), {}

    def step(self, action: np.int64) -> tuple[Picture, float, bool, bool, dict[str, Any]]:
        """The paddle moves, then the ball falls by a row."""
        self._paddle = min(max(self._paddle + int(action) - 1, 0), COLUMNS - 1)
        self._row += 1
        ended = self._row == ROWS - 1
        caught = self._ball == self._paddle
        reward = (1.0 if caught else -1.0) if ended else 0.0
        return self._seen(), reward, ended, False, {"is_success": caught} if ended else {}

    def _seen(self) -> Picture:
        cells = np.full((ROWS, COLUMNS), BACKGROUND, np.uint8)
        cells[ROWS - 1, self._paddle] = PADDLE
        cells[self._row, self._ball] = BALL
        return np.kron(cells, np.ones((CELL_PX, CELL_PX), np.uint8))[:, :, None]


gymnasium.register("Catch-v0", f"{__name__}:{Catch.__name__}")
