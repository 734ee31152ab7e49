"""References of point sets, and seeds of random ones, for tests of the field."""

import numpy as np
from hypothesis import strategies as st

from poil_drake.control.reference.point_trajectory import PointTrajectory

seeds = st.integers(0, 2**32 - 1)


def still_reference(positions, period=1.0):
    """Positions (T, N, 3) with zero velocities."""
    return PointTrajectory(period * np.arange(len(positions)), positions, np.zeros_like(positions))


def resting_reference(body):
    return still_reference(np.stack([body, body]))


def moving_reference(positions, period):
    """Positions (T, N, 3) with their central differences as velocities, at rest at the end."""
    times = period * np.arange(len(positions))
    velocities = np.gradient(positions, times, axis=0)
    velocities[-1] = 0.0
    return PointTrajectory(times, positions, velocities)


def straight_reference(body, count, period=0.25, speed=0.1):
    """Moves along x at constant speed."""
    times = period * np.arange(count)
    return moving_reference(body + speed * times[:, None, None] * np.array([1.0, 0, 0]), period)
