"""A moving body, and states near and far from its motion, for timing controllers."""

from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from poil_drake.control.reference.point_trajectory import PointTrajectory
from poil_drake.geometry.rigid_transform import make_transform, rotation_exp, transform_points

_COUNT, _OUTLIERS = 64, 2
_NOISE = 1e-3
"""Standard deviation of the noise in each coordinate of a tracked point [m]."""


def moving_body(
    *, num_points: int, num_samples: int
) -> tuple[np.ndarray, np.ndarray, PointTrajectory, np.ndarray]:
    """Returns a body's motion in 4 s: a turn by 115 degrees on a curved path of half a metre.

    Returns:
        times: (T,) sample times [s].
        X_WO: (T, 4, 4) poses of the body.
        reference: The motion of its points.
        points: (N, 3) the points in the body's frame, within 4 cm along each axis [m].
    """
    times = np.linspace(0.0, 4.0, num_samples)
    s = np.sin(0.5 * np.pi * times / times[-1])[:, None]
    axis = np.array([0.36, -0.48, 0.8])
    path = np.hstack([0.4 * s, 0.1 * np.sin(3.0 * s), 0.2 * s**2])
    X_WO = make_transform(rotation_exp(2.0 * s * axis), path)
    points = np.random.default_rng(1).uniform(-0.04, 0.04, (num_points, 3))
    positions = transform_points(X_WO, points)
    velocities = np.gradient(positions, times, axis=0)
    velocities[-1] = 0.0
    return times, X_WO, PointTrajectory(times, positions, velocities), points


class States(NamedTuple):
    """S states of the body.

    Attributes:
        poses: (S, 4, 4) poses of the body.
        clean: (S, N, 3) its points with a tracker's noise [m].
        spoilt: (S, N, 3) the same, but with two of the points 5 to 10 cm off [m].
    """

    poses: np.ndarray
    clean: np.ndarray
    spoilt: np.ndarray


OFFSETS = {"near": (0.005, 3.0, 3.0), "far": (0.3, 60.0, 150.0)}
"""Offsets from the motion: distance [m], smallest and largest angle [deg]."""


def make_states(X_WO: np.ndarray, points: np.ndarray, where: str) -> States:
    """Returns states of a body with points (N, 3), off a motion (T, 4, 4) by `OFFSETS[where]`."""
    distance, smallest, largest = OFFSETS[where]
    random = np.random.default_rng(2)
    base = X_WO[random.integers(len(X_WO), size=_COUNT)]
    angle = np.radians(random.uniform(smallest, largest, (_COUNT, 1)))
    turns = Rotation.from_rotvec(angle * _directions(random, _COUNT)).as_matrix()
    shifts = distance * _directions(random, _COUNT)
    poses = make_transform(turns @ base[:, :3, :3], base[:, :3, 3] + shifts)
    clean = transform_points(poses, points)
    clean = clean + random.normal(scale=_NOISE, size=clean.shape)
    spoilt = clean.copy()
    for state in spoilt:
        which = random.choice(len(points), _OUTLIERS, replace=False)
        offsets = random.uniform(0.05, 0.1, (_OUTLIERS, 1))
        state[which] += offsets * _directions(random, _OUTLIERS)
    return States(poses, clean, spoilt)


def _directions(random: np.random.Generator, count: int) -> np.ndarray:
    v = random.normal(size=(count, 3))
    return v / np.linalg.norm(v, axis=1, keepdims=True)
