"""The natural background behind the marker, made of noise and shapes: the same pixels on every machine type.

Value noise of several octaves, as foliage and plaster have it, over a gradient from the floor to the
ceiling; before it some boxes and discs of muted colours. Blue stays low everywhere, so that no pixel, nor
any mixture of pixels that texture filtering makes, has the marker's colour.
"""

import numpy as np
import numpy.typing as npt

SIZE_PX = 512
MAX_BLUE = 170
_SEED = 8
_OCTAVES = (8, 16, 32, 64, 128, 256)  # cells across the texture
_SHAPES = 120

Image = npt.NDArray[np.float64]


def pixels() -> npt.NDArray[np.uint8]:
    """The texture, uint8[512, 512, 3]."""
    random = np.random.default_rng(_SEED)
    noise = np.stack([_fractal(random) for _ in range(3)], axis=-1)
    height = np.linspace(0, 1, SIZE_PX)[:, None, None]
    base = np.array([150.0, 140.0, 120.0]) * height + np.array([90.0, 100.0, 70.0]) * (1 - height)
    # One noise for brightness and a weaker one of each colour: hues vary, but not as wildly.
    image = base + 45 * noise[:, :, :1] + 15 * noise
    y, x = np.mgrid[:SIZE_PX, :SIZE_PX]
    for _ in range(_SHAPES):
        _paint(image, x, y, random)
    image += 12 * noise[:, :, :1]  # shading over everything
    return np.clip(image, 0, (255, 255, MAX_BLUE)).astype(np.uint8)


def _paint(
    image: Image,
    x: npt.NDArray[np.integer],
    y: npt.NDArray[np.integer],
    random: np.random.Generator,
) -> None:
    """One box or disc of a muted colour, anywhere."""
    centre_x, centre_y = random.uniform(0, SIZE_PX), random.uniform(0, SIZE_PX)
    half_width, half_height = random.uniform(4, 24, 2)
    colour = random.uniform(40, 170) + random.uniform(-25, 25, 3)
    across, along = (x - centre_x) / half_width, (y - centre_y) / half_height
    is_disc = random.random() < 0.4
    inside = across**2 + along**2 < 1 if is_disc else np.maximum(abs(across), abs(along)) < 1
    image[inside] = colour


def _fractal(random: np.random.Generator) -> Image:
    """Value noise, each octave twice as fine and 0.7 times as strong; about -1 to 1."""
    octaves = [
        0.7**level * _smooth(random.uniform(-1, 1, (cells + 1, cells + 1)))
        for level, cells in enumerate(_OCTAVES)
    ]
    return np.asarray(np.sum(octaves, axis=0))


def _smooth(lattice: Image) -> Image:
    """The lattice's values, interpolated linearly to the texture's size."""
    cells = len(lattice) - 1
    where = np.linspace(0, cells, SIZE_PX)
    before = np.minimum(where.astype(int), cells - 1)
    weights = np.zeros((SIZE_PX, cells + 1))
    rows = np.arange(SIZE_PX)
    weights[rows, before], weights[rows, before + 1] = 1 - (where - before), where - before
    return weights @ lattice @ weights.T
