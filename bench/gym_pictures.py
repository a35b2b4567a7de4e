"""Draws docs/tasks/gym.png: what environments of other packages show, and what a policy sees of them.

    pip install minigrid ale-py minatar highway-env flappy-bird-gymnasium
    python bench/gym_pictures.py docs/tasks/gym.png

Each is made as `bpn train` makes it, from its task's name and options, and repeats its last action.
"""

import argparse
import contextlib
import random
import sys
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw

from bpn_robot.frame import Frame
from bpn_robot_sim.environment import GymEnvironment
from bpn_robot_sim.gym_robot import GymRobot
from bpn_shared.spec.config import RunConfig
from bpn_shared.spec.gym import modules_named
from bpn_shared.spec.joint_actions import count
from bpn_shared.spec.observation import stack

CELL_PX, GAP_PX, LINE_PX = 168, 6, 14
SEED = 1
HEADINGS = ("picture", "frame, RGB", "earlier frame, or change", "newest frame, gray")


class Shown(NamedTuple):
    """One row of the picture."""

    task: str
    options: dict[str, Any]
    steps: int


ROWS = [
    Shown("gym:minigrid:MiniGrid-LavaCrossingS9N1-v0", {}, 2),
    Shown(
        "gym:minigrid:MiniGrid-LavaCrossingS9N1-v0",
        {
            "env_wrappers": "minigrid.wrappers:RGBImgPartialObsWrapper",
            "observation_key": "image",
        },
        2,
    ),
    Shown("gym:ale_py:ALE/Pong-v5", {"crop": "0,34,160,160"}, 60),
    Shown(
        "gym:ale_py:ALE/SpaceInvaders-v5",
        {
            "env_kwargs": '{"frameskip": 1, "repeat_action_probability": 0}',
            "frame_skip": 4,
            "max_over_frames": 2,
        },
        40,
    ),
    Shown("gym:minatar.gym:MinAtar/Breakout-v1", {}, 7),
    Shown("gym:highway_env:highway-fast-v0", {"difference": True}, 3),
    Shown("gym:flappy_bird_gymnasium:FlappyBird-v0", {"difference": True}, 20),
    Shown("gym:Pendulum-v1", {"action_bins": 5, "crop": "120,120,260,260", "difference": True}, 3),
]


def row(shown: Shown) -> Image.Image:
    """Its name over: the picture, the frame in colour, and the two planes of a gray observation."""
    given = RunConfig.for_task(shown.task, actions=2, **shown.options)
    options, modules = given.alone(), modules_named(shown.task, given.env_wrappers)
    whole = options.model_copy(update={"crop": ""})
    with contextlib.closing(GymEnvironment(shown.task, whole, modules)) as env:
        picture, actions = last_picture(env, shown.steps * given.frame_skip), sum(env.dims)
    config = RunConfig.for_task(shown.task, actions=actions, **shown.options)
    in_colour = RunConfig.for_task(
        shown.task, actions=actions, **shown.options, frame_channels=3, frames_stacked=2
    )
    colours = frames(in_colour, modules, shown.steps)[-1].transpose(1, 2, 0)
    gray = frames(config, modules, shown.steps)
    observation = stack(gray, len(gray) - 1, 2, difference=config.difference)
    cells = [picture, colours, *observation]
    drawn = Image.new("RGB", (4 * CELL_PX + 3 * GAP_PX, CELL_PX + 2 * LINE_PX), "white")
    draw = ImageDraw.Draw(drawn)
    draw.text((0, 0), shown.task, "black")
    told = "  ".join(f"--{name.replace('_', '-')} {value}" for name, value in shown.options.items())
    draw.text((0, LINE_PX - 2), told, "dimgray")
    for place, cell in enumerate(map(Image.fromarray, cells)):
        cell.thumbnail((CELL_PX, CELL_PX))
        scale = CELL_PX / max(cell.size)
        size = round(cell.width * scale), round(cell.height * scale)
        fitted = cell.convert("RGB").resize(size, Image.Resampling.NEAREST)
        drawn.paste(fitted, (place * (CELL_PX + GAP_PX), 2 * LINE_PX))
    return drawn


def last_picture(env: GymEnvironment, steps: int) -> npt.NDArray[np.uint8]:
    """What is to be seen after so many steps, which repeat the last action throughout."""
    begin_alike()
    env.reset(SEED)
    for _ in range(steps):
        env.step(count(env.dims) - 1)
    return env.picture()


def frames(config: RunConfig, modules: list[str], steps: int) -> list[Frame]:
    """The frames of the same actions as a robot shows them."""
    robot = GymRobot(config.task_spec, modules)
    begin_alike()
    shown = [robot.reset(SEED)]
    for _ in range(steps):
        robot.command(config.task_spec.joint_actions - 1)
        robot.settle()
        shown.append(robot.frame())
    robot.close()
    return shown


def begin_alike() -> None:
    """For environments that draw from Python's and numpy's own generators, whatever their seed."""
    random.seed(SEED)
    np.random.seed(SEED)


def main() -> int:
    """Writes the picture."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("output", type=Path)
    rows = [row(shown) for shown in ROWS]
    height = LINE_PX + sum(one.height + 2 * GAP_PX for one in rows)
    page = Image.new("RGB", (rows[0].width + 2 * GAP_PX, height), "white")
    for place, heading in enumerate(HEADINGS):
        ImageDraw.Draw(page).text((GAP_PX + place * (CELL_PX + GAP_PX), 0), heading, "navy")
    top = LINE_PX + GAP_PX
    for one in rows:
        page.paste(one, (GAP_PX, top))
        top += one.height + 2 * GAP_PX
    page.save(parser.parse_args().output, optimize=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
