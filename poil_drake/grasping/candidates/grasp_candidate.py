"""Grasps of the parallel-jaw hand, and sampling parameters."""

from dataclasses import dataclass

import numpy as np

from poil_drake.errors import InvalidValueError
from poil_drake.geometry.frozen_array import SharedOnCopy, freeze_fields
from poil_drake.robots.panda_hand import GripperGeometry

GRIPPER = GripperGeometry()
"""The geometry of the hand that grasps."""


@dataclass(frozen=True, eq=False)
class GraspCandidate(SharedOnCopy):
    """A parallel-jaw grasp.

    Attributes:
        X_WG: (4, 4) gripper frame (+z approach, fingers close along y) at the grasp [m, world].
        width: Visible extent of the grasped surface between the pads, along y [m].
        pregrasp_width: Finger opening while approaching and after releasing [m]. It leaves room for
            a finger that reaches into a hollow object.
        score: Quality in [0, 1]; larger is better.
        contact_points: (2, 3) contacts of the +y and the -y finger [m, world].
    """

    X_WG: np.ndarray
    width: float
    pregrasp_width: float
    score: float
    contact_points: np.ndarray

    def __post_init__(self) -> None:
        freeze_fields(self, X_WG=(4, 4), contact_points=(2, 3))
        R = self.X_WG[:3, :3]
        if not np.allclose(R @ R.T, np.eye(3), atol=1e-6) or np.linalg.det(R) < 0.0:
            raise InvalidValueError(
                f"The rotation part of GraspCandidate.X_WG, {R.tolist()}, is not a rotation.",
                remedy="Pass a rigid transform with an orthonormal, right-handed rotation matrix.",
            )
        if not 0.0 <= self.width <= self.pregrasp_width:
            raise InvalidValueError(
                f"GraspCandidate.width is {self.width} m, which is not in the range from 0 to "
                f"pregrasp_width, {self.pregrasp_width} m.",
                remedy="Pass 0 <= width <= pregrasp_width.",
            )


@dataclass(frozen=True, kw_only=True)
class GraspSamplingConfig:
    """How grasps are sampled.

    Attributes:
        seed_points: Number of surface points at which grasps are tried.
        approach_angle: Largest angle between approach direction and straight down [rad]. If it
            yields too few grasps, larger angles are tried, too.
        part_clearance: Distance that the gripper keeps from the functional part [m], which must
            stay free to meet the fixture.
    """

    seed_points: int = 160
    approach_angle: float = 0.88
    part_clearance: float = 0.010
