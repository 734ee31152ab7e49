"""Reduces many grasps to few diverse ones."""

from collections import Counter

import numpy as np

from poil_drake.geometry.rigid_transform import rotation_angle
from poil_drake.grasping.candidates.grasp_candidate import GraspCandidate

SAME_POSITION, SAME_ANGLE = 0.008, 0.3
"""Grasps are similar if their distance [m] and the angle between them [rad] are below these."""

_AZIMUTH_BINS = 12  # Sectors around the object.
_MAX_CANDIDATES = 48


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
