"""Thins out grasps: the best of similar ones, shared out around the object."""

import numpy as np

from poil_drake.geometry.rigid_transform import rotation_angle
from poil_drake.grasping.candidates.grasp_candidate import GraspCandidate, GraspSamplingConfig


def keep_diverse(
    candidates: list[GraspCandidate], center: np.ndarray, config: GraspSamplingConfig
) -> list[GraspCandidate]:
    """Keeps the best of similar grasps, and of those the best of each sector in turn.

    Args:
        candidates: Grasps of one object.
        center: (3,) the object's centre, around which sectors are counted [m, world].
        config: What counts as similar, the sectors, and how many to keep.

    Returns:
        At most `config.max_candidates`, those of better rank within their sector first.
    """
    if not candidates:
        return []
    best = dissimilar(
        np.array([candidate.X_WG for candidate in candidates]),
        np.array([candidate.score for candidate in candidates]),
        config.same_position,
        config.same_angle,
    )
    kept = [candidates[i] for i in best]
    ranks: dict[int, int] = {}
    order: list[tuple[int, float, int]] = []
    for candidate in kept:
        offset = candidate.X_WG[:3, 3] - center
        turn = np.arctan2(offset[1], offset[0]) / (2.0 * np.pi)
        sector = int(turn * config.azimuth_bins) % config.azimuth_bins
        ranks[sector] = ranks.get(sector, -1) + 1
        order.append((ranks[sector], -candidate.score, len(order)))
    chosen = sorted(range(len(kept)), key=lambda i: order[i])
    return [kept[i] for i in chosen[: config.max_candidates]]


def dissimilar(
    poses: np.ndarray, merits: np.ndarray, same_position: float, same_angle: float
) -> list[int]:
    """Returns the indices of poses, best first, less those similar to a better one.

    Args:
        poses: (K, 4, 4) gripper poses [m].
        merits: (K,) larger is better; ties go to the lower index.
        same_position: Poses closer than this ... [m]
        same_angle: ... and turned by less than this are similar [rad].
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
