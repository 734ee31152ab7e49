"""Parameters of the rigid-flow tracker."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, kw_only=True)
class RigidFlowConfig:
    """What depends on the task and on the computer.

    Speeds are standard deviations of how fast the object departs from its predicted motion. Over a
    step of 1/8 s, 20 deg/s and 0.04 m/s are 2.5 deg and 5 mm.

    Attributes:
        aligned_points: Surface points that enter the alignment. The cost is in proportion.
        support_points: Points, spread over the object, that measure how much of it is seen (POIL
            uses 40).
        free_angular_speed: Without a motion prior, where the velocity is extrapolated [rad/s].
        free_linear_speed: Likewise [m/s].
        prior_angular_speed: With a motion prior [rad/s].
        prior_linear_speed: Likewise [m/s].
        grow: Whether the model grows while there is no motion prior.
        grow_with_motion_prior: Whether it also grows with one. A hand that holds the object moves
            as the object does, so growth cannot tell the two apart.
    """

    aligned_points: int = 1200
    support_points: int = 40
    free_angular_speed: float = float(np.radians(20.0))
    free_linear_speed: float = 0.04
    prior_angular_speed: float = float(np.radians(8.0))
    prior_linear_speed: float = 0.015
    grow: bool = True
    grow_with_motion_prior: bool = False
