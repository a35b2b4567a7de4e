"""Draws docs/learning.gif, the README's animated picture: one robot in three iterations of one run, side by side.

python docs/learning_picture.py            # trains a run of its own, minutes
python docs/learning_picture.py --run RUN  # draws one that is there
"""

import argparse
import tempfile
from collections.abc import Iterator
from pathlib import Path

import cv2
import imageio.v3 as imageio
import numpy as np
import numpy.typing as npt

import bpn
from bpn_shared.messages.episode import Episode

Picture = npt.NDArray[np.uint8]

TASK, SEED = "reaching", 1
SCALE, GAP_PX, CAPTION_PX = 3, 12, 34
PAPER, INK = 250, 40
HOLD_FRAMES = 12
"""The last picture stands still, before all begins again."""


def pictures(episodes: list[Episode], captions: list[str]) -> Iterator[Picture]:
    """Gray pictures uint8[h, w] of the episodes beside each other; one that is over stands still."""
    steps = max(len(one.frames) for one in episodes)
    for step in range(steps):
        panels = [
            panel(one.frames[min(step, len(one.frames) - 1)], caption)
            for one, caption in zip(episodes, captions, strict=True)
        ]
        gap = np.full((panels[0].shape[0], GAP_PX), PAPER, np.uint8)
        row = [gap]
        for one in panels:
            row += [one, gap]
        yield np.hstack(row)


def panel(frame: Picture, caption: str) -> Picture:
    """One enlarged frame uint8[c, h, w] under its caption."""
    shown = frame.mean(axis=0).astype(np.uint8).repeat(SCALE, axis=0).repeat(SCALE, axis=1)
    head = np.full((CAPTION_PX, shown.shape[1]), PAPER, np.uint8)
    cv2.putText(head, caption, (2, 22), cv2.FONT_HERSHEY_SIMPLEX, 0.5, INK, 1, cv2.LINE_AA)
    foot = np.full((GAP_PX, shown.shape[1]), PAPER, np.uint8)
    return np.vstack([head, shown, foot])


def draw(run: bpn.Run, path: Path) -> None:
    """Writes the picture of a finished run."""
    iterations = run.config.iterations
    chosen = [0, iterations // 5, iterations - 1]
    episodes = [next(run.episodes(iteration)) for iteration in chosen]
    captions = [
        f"iteration {iteration + 1}: {one.rewards.sum():.0f} px"
        for iteration, one in zip(chosen, episodes, strict=True)
    ]
    film = list(pictures(episodes, captions))
    film += film[-1:] * HOLD_FRAMES
    period_ms = 1000 * run.config.task_spec.control_period_s
    path.write_bytes(
        imageio.imwrite("<bytes>", np.stack(film), extension=".gif", duration=period_ms, loop=0)
    )


def main() -> None:
    """Trains a run if none is named, and draws it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--run", help="folder of a finished run; by default one is trained")
    parser.add_argument("--output", type=Path, default=Path(__file__).with_name("learning.gif"))
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        found = bpn.open_run(options.run) if options.run else None
        draw(found or bpn.train(TASK, seed=SEED, runs_dir=folder), options.output)


if __name__ == "__main__":
    main()
