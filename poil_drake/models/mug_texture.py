"""Generates the texture images of the mug family."""

import numpy as np

from poil_drake.models.mug_family import MugParameters
from poil_drake.models.mug_mesh import DECORATED_FRACTION

TEXTURE_SIZE = (256, 512)
"""Height and width of a texture image [px]."""

_SHADES = 6  # Number of colours in a noise texture; a small one keeps the image file small.


def texture_image(mug: MugParameters) -> np.ndarray:
    """Returns the (H, W, 3) uint8 RGB texture of a decorated mug.

    The decoration is above a strip of the base colour. The same parameters give the same image.
    """
    height, width = TEXTURE_SIZE
    rows = round(height * DECORATED_FRACTION)
    pattern = np.zeros((height, width))
    pattern[:rows] = _PATTERNS[mug.texture](np.random.default_rng(mug.seed), rows, width)
    # The lowest decorated rows stay plain, so that no decoration bleeds into the inside.
    pattern[rows - 4 :] = 0.0
    color, accent = np.array(mug.color), np.array(mug.accent)
    image = color + pattern[..., None] * (accent - color)
    return np.round(255 * np.clip(image, 0, 1)).astype(np.uint8)


def _stripes(rng: np.random.Generator, rows: int, columns: int) -> np.ndarray:
    """Returns the (rows, columns) weights of the accent colour: slanted stripes of varied width."""
    y, x = np.mgrid[:rows, :columns]
    phase = 2 * np.pi * (6 * x / columns + 2.0 * y / rows)
    return (np.sin(phase) > 0.6 * np.sin(2 * np.pi * x / columns)).astype(float)


def _checks(rng: np.random.Generator, rows: int, columns: int) -> np.ndarray:
    """Returns the (rows, columns) weights of the accent colour: a checkerboard in four shades."""
    shades = rng.choice([0.4, 0.6, 0.8, 1.0], size=(8, 16))
    y, x = np.mgrid[:rows, :columns]
    i, j = y * 8 // rows, x * 16 // columns
    return ((i + j) % 2) * shades[i, j]


def _dots(rng: np.random.Generator, rows: int, columns: int) -> np.ndarray:
    y, x = np.mgrid[:rows, :columns]
    pattern = np.zeros((rows, columns))
    for _ in range(60):
        cx, cy, r = rng.uniform(0, columns), rng.uniform(0, rows), rng.uniform(8, 18)
        dx = np.minimum(np.abs(x - cx), columns - np.abs(x - cx))
        pattern[dx**2 + (y - cy) ** 2 < r**2] = 1.0
    return pattern


def _noise(rng: np.random.Generator, rows: int, columns: int) -> np.ndarray:
    """Returns the (rows, columns) weights of the accent colour: speckles without a seam."""
    import cv2

    pattern = np.zeros((rows, columns))
    for cells, weight in ((8, 0.3), (24, 0.4), (64, 0.3)):
        coarse = rng.uniform(size=(max(2, cells * rows // columns), cells))
        coarse = np.concatenate([coarse, coarse[:, :1]], axis=1)
        pattern += weight * cv2.resize(coarse, (columns, rows), interpolation=cv2.INTER_LINEAR)
    low, high = np.quantile(pattern, [0.02, 0.98])
    pattern = np.clip((pattern - low) / (high - low), 0, 1)
    return np.round(pattern * (_SHADES - 1)) / (_SHADES - 1)


def _logo(rng: np.random.Generator, rows: int, columns: int) -> np.ndarray:
    """Returns the (rows, columns) weights of the accent colour: random logos on two sides."""
    pattern = np.zeros((rows, columns))
    cells, size = 9, rows * 3 // 4 // 9
    for center in (columns // 4, 3 * columns // 4):
        half = rng.uniform(size=(cells, cells // 2 + 1)) < 0.5
        blocks = np.concatenate([half, half[:, -2::-1]], axis=1)
        blocks[[0, -1]] = True
        blocks[:, [0, -1]] = True
        sign = np.kron(blocks, np.ones((size, size)))
        top, left = (rows - len(sign)) // 2, center - len(sign) // 2
        pattern[top : top + len(sign), left : left + len(sign)] = sign
    return pattern


_PATTERNS = {
    "stripes": _stripes,
    "checks": _checks,
    "dots": _dots,
    "noise": _noise,
    "logo": _logo,
}
