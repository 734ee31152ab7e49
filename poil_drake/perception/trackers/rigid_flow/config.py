"""Parameters of the rigid-flow tracker."""

from dataclasses import dataclass, field, fields

import numpy as np

from poil_drake.perception.positive_fields import check_positive


@dataclass(frozen=True, kw_only=True)
class RigidFlowConfig:
    """Parameters that depend on the task and on the computer.

    The speeds are standard deviations: they say how fast the object may depart from its predicted
    motion. In a step of 1/8 s, 20 deg/s and 0.04 m/s are 2.5 deg and 5 mm.

    Attributes:
        aligned_points: Number of surface points to align. The computing time is proportional to it.
        support_points: Number of points, spread over the object, that measure how much of the
            object the views show (POIL uses 40); in a scenario, `poil.num_support_points`.
        free_angular_speed: Departure in rotation from an extrapolated velocity, which is the
            prediction without a motion prior [rad/s].
        free_linear_speed: Departure in translation from an extrapolated velocity [m/s].
        prior_angular_speed: Departure in rotation from a motion prior [rad/s].
        prior_linear_speed: Departure in translation from a motion prior [m/s].
    """

    aligned_points: int = 1200
    support_points: int = field(default=40, metadata={"yaml": False})
    free_angular_speed: float = float(np.radians(20.0))
    free_linear_speed: float = 0.04
    prior_angular_speed: float = float(np.radians(8.0))
    prior_linear_speed: float = 0.015

    def __post_init__(self) -> None:
        check_positive(self, *(field.name for field in fields(self)))
