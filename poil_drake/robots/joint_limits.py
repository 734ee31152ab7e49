"""Limits of an arm's joints."""

from dataclasses import dataclass

import numpy as np

from poil_drake.errors import InvalidValueError
from poil_drake.geometry.frozen_array import SharedOnCopy, freeze_fields


@dataclass(frozen=True, kw_only=True, eq=False)
class JointLimits(SharedOnCopy):
    """Limits of n joints.

    Attributes:
        lower: (n,) smallest positions [rad].
        upper: (n,) largest positions [rad].
        velocity: (n,) largest speeds [rad/s].
        acceleration: (n,) largest accelerations [rad/s^2].
    """

    lower: np.ndarray
    upper: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray

    def __post_init__(self) -> None:
        n = ("n",)
        freeze_fields(self, finite=False, lower=n, upper=n, velocity=n, acceleration=n)
        ordered = np.all(self.lower < self.upper)
        if not ordered or not np.all(self.velocity > 0.0) or not np.all(self.acceleration > 0.0):
            raise InvalidValueError(
                f"These joint limits leave no room to move: {self}.",
                remedy="Pass lower < upper, and positive velocity and acceleration.",
            )

    def velocity_bounds(
        self, positions: np.ndarray, *, margin: float, braking_gain: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Returns the lowest and the highest allowed velocities, (n,) [rad/s] each.

        A joint approaches the point `margin` before its limit no faster than `braking_gain` times
        its distance from that point, so that it brakes smoothly and stops there. Beyond that point
        the joint may only move back. Rest is always allowed.

        Args:
            positions: (n,) joint positions [rad].
            margin: Distance to keep from the position limits [rad].
            braking_gain: Speed per remaining distance [1/s].
        """
        highest = braking_gain * (self.upper - margin - positions)
        lowest = braking_gain * (self.lower + margin - positions)
        return (
            np.minimum(np.maximum(lowest, -self.velocity), 0.0),
            np.minimum(np.maximum(highest, 0.0), self.velocity),
        )
