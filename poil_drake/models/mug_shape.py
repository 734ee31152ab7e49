"""The outlines of a mug: the profile of its wall and the centre line of its handle."""

import numpy as np

from poil_drake.models.mug_family import MugParameters

_EXPONENTS = {"c": 2.0, "d": 3.0, "square": 5.0, "ear": 2.3}  # Of the handle's superellipse.
_EAR_SKEW = 0.16  # How much farther an ear reaches at its top than at its middle, relative.
_RIM_STEPS = 4
BOTTOM_FACTOR = 1.6  # Ratio of the bottom's thickness to the wall's; cups are bottom-heavy.


def outer_radius(mug: MugParameters, z: float | np.ndarray) -> float | np.ndarray:
    """Returns the outer radius of the body [m] at height z [m]."""
    return mug.radius * (mug.taper + (1 - mug.taper) * np.asarray(z) / mug.height)


def wall_profile(mug: MugParameters) -> tuple[np.ndarray, np.ndarray]:
    """Returns the body's outline as two polylines of (radius, height) [m].

    Returns:
        The outside, from the axis along the underside up to the rim, and the inside, from the rim
        down to the axis. They meet at the crest of the rim.
    """
    bottom = BOTTOM_FACTOR * mug.wall
    foot = float(outer_radius(mug, 0.0))
    chamfer = 0.003
    angles = np.linspace(0, np.pi / 2, _RIM_STEPS)
    lip = mug.wall / 2
    rim = float(outer_radius(mug, mug.height)) - lip
    crest = mug.height - lip
    heights = np.linspace(chamfer, crest, 9)
    outside = np.concatenate(
        [
            [[0.0, 0.0], [foot - chamfer, 0.0]],
            np.stack([outer_radius(mug, heights), heights], axis=1),
            np.stack([rim + lip * np.cos(angles[1:]), crest + lip * np.sin(angles[1:])], axis=1),
        ]
    )
    heights = np.linspace(crest, bottom + 2 * chamfer, 4)
    inner = np.asarray(outer_radius(mug, heights)) - mug.wall
    floor = float(outer_radius(mug, bottom)) - mug.wall
    inner_lip = angles + np.pi / 2
    inside = np.concatenate(
        [
            np.stack([rim + lip * np.cos(inner_lip), crest + lip * np.sin(inner_lip)], axis=1),
            np.stack([inner[1:], heights[1:]], axis=1),
            [[floor - 2 * chamfer, bottom], [0.0, bottom]],
        ]
    )
    return outside, inside


def handle_center_line(mug: MugParameters, count: int) -> np.ndarray:
    """Returns points along the centre of the handle's tube, from its upper to its lower end.

    The curve is the half x >= 0 of a superellipse |x/a|^n + |z/b|^n = 1, centred on the wall of the
    body. The top of an ear-shaped handle is skewed outwards. The ends reach into the wall.

    Returns:
        (count, 3) positions in the mug's frame [m], at equal distances along the curve.
    """
    exponent = 2 / _EXPONENTS[mug.handle_shape]
    reach = mug.handle_clearance + mug.handle_radius
    half = mug.handle_opening / 2 + mug.handle_radius
    angle = np.linspace(np.pi / 2, -np.pi / 2, 400)
    x = reach * np.abs(np.cos(angle)) ** exponent
    z = half * np.sign(np.sin(angle)) * np.abs(np.sin(angle)) ** exponent
    if mug.handle_shape == "ear":
        x = x * (1 + _EAR_SKEW * z / half)
    z = z + mug.handle_height
    middle = float(outer_radius(mug, mug.handle_height))
    ends = np.asarray(outer_radius(mug, z[[0, -1]])) - 0.6 * mug.wall
    x = middle + x
    curve = np.stack([x, np.zeros_like(x), z], axis=1)
    curve = np.concatenate([[[ends[0], 0.0, z[0]]], curve, [[ends[1], 0.0, z[-1]]]])
    length = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1))])
    even = np.linspace(0, length[-1], count)
    return np.stack([np.interp(even, length, curve[:, i]) for i in range(3)], axis=1)
