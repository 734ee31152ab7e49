"""Grasps of the parallel-jaw hand, their reduction to diverse ones, and sampling parameters."""

from collections import Counter
from dataclasses import dataclass

import numpy as np

from poil_drake.errors import InvalidValueError
from poil_drake.geometry.frozen_array import SharedOnCopy, freeze_fields
from poil_drake.geometry.rigid_transform import rotation_angle
from poil_drake.robots.panda_hand import GripperGeometry

GRIPPER = GripperGeometry()
"""The geometry of the hand that grasps."""

SAME_POSITION, SAME_ANGLE = 0.008, 0.3
"""Grasps are similar if their distance [m] and the angle between them [rad] are below these."""

_AZIMUTH_BINS = 12  # Sectors around the object.
_MAX_CANDIDATES = 48


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


def keep_diverse(candidates: list[GraspCandidate], center: np.ndarray) -> list[GraspCandidate]:
    """Returns the best of each group of similar grasps, taking turns among sectors of the object.

    Args:
        candidates: Grasps of one object.
        center: (3,) the object's centre [m, world].

    Returns:
        At most `_MAX_CANDIDATES` grasps: first the best of each sector around the object's vertical
        axis, then the second best of each sector, and so on.
    """
    if not candidates:
        return []
    best = dissimilar(
        np.array([candidate.X_WG for candidate in candidates]),
        np.array([candidate.score for candidate in candidates]),
        SAME_POSITION,
        SAME_ANGLE,
    )
    kept = [candidates[i] for i in best]
    taken: Counter[int] = Counter()
    ranks = []
    for candidate in kept:
        offset = candidate.X_WG[:3, 3] - center
        turn = np.arctan2(offset[1], offset[0]) / (2.0 * np.pi)
        sector = int(turn * _AZIMUTH_BINS) % _AZIMUTH_BINS
        ranks.append(taken[sector])
        taken[sector] += 1
    # Within a rank, the best come first, as in `kept`.
    return [kept[i] for i in np.argsort(ranks, kind="stable")[:_MAX_CANDIDATES]]


def dissimilar(
    poses: np.ndarray, merits: np.ndarray, same_position: float, same_angle: float
) -> list[int]:
    """Returns the indices of poses, best first, without poses that are similar to a better one.

    Args:
        poses: (K, 4, 4) gripper poses [m].
        merits: (K,) larger is better; ties go to the lower index.
        same_position: Similar poses are closer than this [m].
        same_angle: Similar poses also differ by less than this angle [rad].
    """
    left = np.ones(len(poses), dtype=bool)
    kept = []
    for i in np.argsort(-merits, kind="stable"):
        if not left[i]:
            continue
        kept.append(int(i))
        offsets = poses[:, :3, 3] - poses[i, :3, 3]
        near = left & (np.linalg.norm(offsets, axis=1) < same_position)
        near[near] = rotation_angle(poses[near, :3, :3] @ poses[i, :3, :3].T) < same_angle
        left &= ~near
    return kept
