"""What disturbs a robot's camera and servos, as data of a task: kinds of disturbance and how strong they are.

A level is a range, low..high, of which every episode draws its own; a single number is that number in every
episode. What is not named is off. `bpn_shared.camera` does to pictures what is said here.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

from pydantic import AfterValidator

from bpn_shared.errors import InputError
from bpn_shared.spec.seeds import disturbance_uniforms

Range = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Kind:
    """One kind of disturbance.

    Attributes:
        number: of its random numbers, for ever: another kind beside it changes none of them.
        lowest, highest: of its level.
        what: what a level is, with its unit.
        scope: what it concerns: pictures; "servo", a simulated servo's play; "time", when actions act.
    """

    number: int
    lowest: float
    highest: float
    what: str
    scope: str = "picture"


KINDS: dict[str, Kind] = {
    "noise": Kind(
        0, 0, 128, "Gaussian noise of every pixel, its standard deviation in levels of 255"
    ),
    "offset": Kind(1, -128, 128, "levels of 255 added to every pixel"),
    "gain": Kind(2, 0.1, 3, "factor on every pixel"),
    "white_balance": Kind(3, 0, 0.5, "largest change of each colour's factor; nothing in gray"),
    "blur": Kind(4, 0, 5, "standard deviation of a Gaussian blur, in pixels"),
    "jpeg": Kind(5, 1, 100, "quality of JPEG compression"),
    "exposure": Kind(6, 0, 0.9, "largest change of each frame's factor"),
    "salt_pepper": Kind(7, 0, 0.5, "share of pixels that are black or white"),
    "latency": Kind(
        8, 0, 2000, "time in ms by which an action acts later, its own for each", "time"
    ),
    "backlash": Kind(9, 0, 45, "play of the servos, in the unit of the task's actions", "servo"),
}


def checked(levels: Mapping[str, Range]) -> dict[str, Range]:
    """The levels, in the order of `KINDS`.

    Raises:
        ValueError: a kind is unknown, or a range is none or outside its limits.
    """
    for name, (low, high) in levels.items():
        if name not in KINDS:
            raise ValueError(f"disturbance {name!r} is unknown; one of: {', '.join(KINDS)}")
        kind = KINDS[name]
        if not kind.lowest <= low <= high <= kind.highest:  # of nan, neither
            raise ValueError(
                f"{name} = {_shown((low, high))}: must be within {kind.lowest:g}..{kind.highest:g}, the lower "
                f"end first ({kind.what})"
            )
    return {name: levels[name] for name in KINDS if name in levels}


Disturbances = Annotated[dict[str, Range], AfterValidator(checked)]


def parse(text: str) -> dict[str, Range]:
    """Levels from text such as "noise=25,offset=-30..30"; "" is none.

    Raises:
        InputError: it is no such text, or a level is impossible.
    """
    levels: dict[str, Range] = {}
    for part in filter(None, (part.strip() for part in text.split(","))):
        name, equals, given = part.partition("=")
        low, _, high = given.partition("..")
        try:
            level = float(low), float(high or low)
        except ValueError:
            level = math.nan, math.nan
        if not equals or math.isnan(sum(level)):
            raise InputError(
                f"disturbance {part!r}: must be KIND=LEVEL or KIND=LOWEST..HIGHEST, separated by commas, "
                "noise=25,offset=-30..30 say"
            )
        if name in levels:
            raise InputError(f"disturbance {name!r} is given twice")
        levels[name] = level
    try:
        return checked(levels)
    except ValueError as error:
        raise InputError(str(error)) from error


def shown(levels: Mapping[str, Range]) -> str:
    """The levels as `parse` takes them."""
    return ",".join(f"{name}={_shown(level)}" for name, level in levels.items())


def of_scope(levels: Mapping[str, Range], scope: str) -> dict[str, Range]:
    """Those that concern pictures, servos or time."""
    return {name: level for name, level in levels.items() if KINDS[name].scope == scope}


def drawn(levels: Mapping[str, Range], episode_seed: int) -> dict[str, float]:
    """Each kind's level in an episode, uniform in its range; no kind changes what another draws."""
    uniforms = disturbance_uniforms(episode_seed, len(KINDS))
    return {
        name: low + (high - low) * float(uniforms[KINDS[name].number, 0])
        for name, (low, high) in levels.items()
    }


def _shown(level: Range) -> str:
    low, high = (repr(end).removesuffix(".0") for end in level)
    return low if low == high else f"{low}..{high}"
