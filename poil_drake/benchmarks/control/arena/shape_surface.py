"""Points on the surfaces of shapes."""

import numpy as np
from pydrake.geometry import Box, Capsule, Cylinder, Shape, Sphere

from poil_drake.errors import InvalidValueError


def shape_surface(shape: Shape, spacing: float) -> np.ndarray:
    """Returns points (P, 3) on the surface of a shape [m], in the frame of the shape.

    Args:
        shape: A box, sphere, cylinder or capsule.
        spacing: Distance between neighbouring points [m].

    Raises:
        InvalidValueError: if the shape is of another kind.
    """
    if isinstance(shape, Box):
        return _box(np.array(shape.size()), spacing)
    if isinstance(shape, Sphere):
        return _revolved(*_arc(shape.radius(), 0.0, np.pi, spacing), spacing)
    if isinstance(shape, Cylinder | Capsule):
        r, half = shape.radius(), shape.length() / 2
        side = np.linspace(-half, half, _count(2 * half, spacing))
        if isinstance(shape, Cylinder):
            top = np.linspace(0.0, r, _count(r, spacing))
            above = np.zeros(top.size)
        else:
            top, above = _arc(r, 0.0, np.pi / 2, spacing)
        radii = np.concatenate([top, np.full(side.size, r), top])
        heights = np.concatenate([half + above, side, -half - above])
        return _revolved(radii, heights, spacing)
    raise InvalidValueError(
        f"The shape {type(shape).__name__} of a collision geometry is not supported.",
        remedy="Use only boxes, spheres, cylinders and capsules as collision geometries.",
    )


def _count(length: float, spacing: float) -> int:
    return max(int(np.ceil(length / spacing)), 1) + 1


def _arc(radius: float, begin: float, end: float, spacing: float) -> tuple[np.ndarray, np.ndarray]:
    """Returns points on an arc between two polar angles: distances from the z axis, heights."""
    angle = np.linspace(begin, end, _count(radius * (end - begin), spacing))
    return radius * np.sin(angle), radius * np.cos(angle)


def _revolved(radii: np.ndarray, heights: np.ndarray, spacing: float) -> np.ndarray:
    """Returns points (P, 3) on the surface that an outline sweeps as it rotates about z."""
    rings = []
    for r, z in zip(radii, heights, strict=True):
        angle = np.linspace(0.0, 2 * np.pi, max(_count(2 * np.pi * r, spacing) - 1, 1), False)
        rings.append(np.stack([r * np.cos(angle), r * np.sin(angle), np.full(angle.size, z)], 1))
    return np.concatenate(rings)


def _box(size: np.ndarray, spacing: float) -> np.ndarray:
    """Returns the points (P, 3) of a grid that lie on a box's faces."""
    axes = [np.linspace(-s / 2, s / 2, _count(s, spacing)) for s in size]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    on_face = np.isclose(np.abs(grid), size / 2).any(axis=1)
    return grid[on_face]
