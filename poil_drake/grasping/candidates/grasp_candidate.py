"""What a grasp is, and what makes a good one."""

from dataclasses import dataclass, field

import numpy as np

from poil_drake.errors import InvalidValueError
from poil_drake.geometry.frozen_array import SharedOnCopy, frozen_array
from poil_drake.robots.panda_hand import GripperGeometry


@dataclass(frozen=True, eq=False)
class GraspCandidate(SharedOnCopy):
    """A parallel-jaw grasp.

    Attributes:
        X_WG: (4, 4) gripper frame (+z approach, fingers close along y) at the grasp [m, world].
        width: Extent of what is between the pads, along y, as far as it was seen [m].
        pregrasp_width: Finger opening while approaching, and again when releasing [m]; small
            enough that a finger which goes inside the object fits there.
        score: Quality in [0, 1]; larger is better.
        contact_points: (2, 3) where the +y and the -y finger touch [m, world].
    """

    X_WG: np.ndarray
    width: float
    pregrasp_width: float
    score: float
    contact_points: np.ndarray

    def __post_init__(self) -> None:
        X_WG = frozen_array(self.X_WG, name="GraspCandidate.X_WG", shape=(4, 4))
        R = X_WG[:3, :3]
        if not np.allclose(R @ R.T, np.eye(3), atol=1e-6) or np.linalg.det(R) < 0.0:
            raise InvalidValueError(
                "GraspCandidate.X_WG does not hold a rotation matrix.",
                remedy="Pass a rigid transform with an orthonormal, right-handed rotation.",
            )
        if not 0.0 <= self.width <= self.pregrasp_width:
            raise InvalidValueError(
                f"GraspCandidate has width {self.width} and pregrasp_width {self.pregrasp_width}.",
                remedy="The fingers must open at least as wide as what they grasp.",
            )
        object.__setattr__(self, "X_WG", X_WG)
        object.__setattr__(
            self,
            "contact_points",
            frozen_array(self.contact_points, name="GraspCandidate.contact_points", shape=(2, 3)),
        )

    @property
    def approach(self) -> np.ndarray:
        """The approach direction (3,) in the world."""
        return self.X_WG[:3, 2]

    @property
    def closing_axis(self) -> np.ndarray:
        """The direction (3,) along which the fingers close, in the world."""
        return self.X_WG[:3, 1]

    def pregrasp_pose(self, distance: float) -> np.ndarray:
        """Returns the gripper pose (4, 4) backed off along the approach direction.

        Args:
            distance: How far [m].
        """
        X = self.X_WG.copy()
        X[:3, 3] -= distance * self.approach
        return X


@dataclass(frozen=True, kw_only=True)
class GraspSamplingConfig:
    """How grasps are sampled and which are kept.

    Attributes:
        gripper: The shape of the hand.
        cloud_voxel: The object's cloud is thinned to one point per cube of this edge [m]; finer
            only takes longer.
        seed_points: Surface points from which grasps are tried.
        normal_radius: Neighbourhood of the surface normals that give the closing axes [m]: wide
            enough that both faces of a thin, noisy wall fall into it and the normal is the wall's.
        spins: Approach directions tried about each closing axis, over the full turn.
        approach_angle: Largest angle between approach direction and straight down [rad].
        wide_approach_angle: The same where that yields too few grasps [rad], as with a mug that
            lies on its side and shows its rim to the front.
        few_candidates: Fewer grasps than this are too few.
        insertion_depths: How far the fingertips reach past the object's edge [m]. The pads are
            18 mm long; less than 12 mm holds poorly, and more lets the hand come near the edge.
        body_depths: The same where more than a thin wall is held [m], as far as the fingers reach:
            the widest place of a round body lies deep.
        thin_wall: What is no wider than this is a thin wall [m].
        gap: A gap in the points along the closing axis wider than this separates two walls [m].
        opening_clearances: Room between each finger and the object before closing [m], the most
            generous that fits is taken; it absorbs the error of cameras and arm.
        pad_width: Width of a pad along x [m].
        pad_length: Length of a pad along z [m].
        surface_noise: Points this near to the outermost one along an axis count as the same
            surface [m]: about three standard deviations of a depth camera's noise.
        contact_offset: Farthest that a contact's middle may lie from the middle of the pad, along
            x [m]; a seventh of the pad's width.
        min_points: Points that must lie between the pads.
        max_stray_points: Points inside the gripper's volume that are taken for noise.
        friction_angle: Largest angle between closing axis and surface normal at a contact [rad];
            0.4 is the friction cone of a coefficient of 0.42.
        part_clearance: Distance that the gripper keeps from the functional part [m], which must
            stay free to meet the fixture.
        ground_clearance: Distance that the gripper keeps from the table [m].
        approach_length: Free path of the gripper before the grasp [m].
        same_position: Grasps closer than this ... [m]
        same_angle: ... and turned by less than this count as one [rad].
        azimuth_bins: Sectors around the object, among which the kept grasps are shared out.
        max_candidates: How many are kept.
    """

    gripper: GripperGeometry = field(default_factory=GripperGeometry)
    cloud_voxel: float = 0.003
    seed_points: int = 160
    normal_radius: float = 0.010
    spins: int = 16
    approach_angle: float = 0.88
    wide_approach_angle: float = 1.4
    few_candidates: int = 16
    insertion_depths: tuple[float, ...] = (0.016, 0.012)
    body_depths: tuple[float, ...] = (0.036, 0.026)
    thin_wall: float = 0.015
    gap: float = 0.009
    opening_clearances: tuple[float, ...] = (0.012, 0.009, 0.006)
    pad_width: float = 0.018
    pad_length: float = 0.0185
    surface_noise: float = 0.003
    contact_offset: float = 0.0026
    min_points: int = 8
    max_stray_points: int = 1
    friction_angle: float = 0.4
    part_clearance: float = 0.010
    ground_clearance: float = 0.006
    approach_length: float = 0.10
    same_position: float = 0.008
    same_angle: float = 0.3
    azimuth_bins: int = 12
    max_candidates: int = 48
