"""How much `bpn bench dashboard` measures."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Sizes:
    """What the figures are of.

    Attributes:
        runs: with long series, in groups of `seeds`.
        points: of each of these runs.
        listed: runs in the table.
        lines: of a metrics file that is taken in.
        repeats: of every request; told is the median.
        camera_s: how long the cameras are watched.
        deaf_s: how long the server's memory is watched while a client reads nothing.
        window_s: how long steps are counted with that client, and without.
        rounds: the fewest and the most pairs of such windows.
    """

    runs: int = 100
    points: int = 100_000
    seeds: int = 10
    listed: int = 10_000
    lines: int = 20_000
    repeats: int = 9
    camera_s: float = 10.0
    deaf_s: float = 30.0
    window_s: float = 5.0
    rounds: tuple[int, int] = (12, 40)


QUICK = Sizes(
    runs=20, points=5_000, listed=600, lines=2_000, repeats=3,
    camera_s=2.0, deaf_s=3.0, window_s=3.0, rounds=(3, 3),
)  # fmt: skip
"""To see that everything works; its figures say nothing."""
