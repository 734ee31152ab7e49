"""Parameters of the rigid-flow tracker."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, kw_only=True)
class RigidFlowConfig:
    """Parameters that depend on the task and on the computer.

    Speeds are standard deviations of how fast the object departs from its predicted motion. In a
    step of 1/8 s, 20 deg/s and 0.04 m/s are 2.5 deg and 5 mm.

    Attributes:
        aligned_points: Number of surface points to align. The cost is proportional to it.
        support_points: Number of points, spread over the object, that measure how much of it is
            seen (POIL uses 40).
        free_angular_speed: Without a motion prior, when the velocity is extrapolated [rad/s].
        free_linear_speed: The same for the translation [m/s].
        prior_angular_speed: With a motion prior [rad/s].
        prior_linear_speed: The same for the translation [m/s].
        grow: Whether the model grows while there is no motion prior.
        grow_with_motion_prior: Whether the model grows while there is one. A hand that holds the
            object moves with it, so growth cannot tell the two apart.
    """

    aligned_points: int = 1200
    support_points: int = 40
    free_angular_speed: float = float(np.radians(20.0))
    free_linear_speed: float = 0.04
    prior_angular_speed: float = float(np.radians(8.0))
    prior_linear_speed: float = 0.015
    grow: bool = True
    grow_with_motion_prior: bool = False
