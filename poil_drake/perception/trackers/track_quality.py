"""Whether the views bear a pose out, and how far the points are to be believed."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from poil_drake.perception.trackers.contour_term import match_contour
from poil_drake.perception.trackers.depth_term import OrientedPoints, sample_depth
from poil_drake.perception.trackers.object_model import ObjectModel
from poil_drake.perception.trackers.pose_alignment import PoseEstimate
from poil_drake.perception.trackers.rigid_flow_config import QualityConfig, RigidFlowConfig
from poil_drake.perception.trackers.view_window import ViewWindow


@dataclass(frozen=True, eq=False)
class Evidence:
    """What the views say about a pose, in numbers of model points that should be seen.

    Attributes:
        seen: Measured depth agrees.
        through: Measured depth is farther: the camera sees through where the object should be.
        ahead: Something is a little nearer: a wrong pose, or a thing that touches the object.
        hidden: Something is much nearer and hides the object.
        support: How many of the support points some view shows.
        edges: Share of the outline, where nothing hides it, whose edge is where it should be.
    """

    seen: int
    through: int
    ahead: int
    hidden: int
    support: int
    edges: float

    @property
    def agreement(self) -> float:
        """The share of points that agree, of those that nothing hides; 0 where there are none."""
        looked_at = self.seen + self.through + self.ahead
        return self.seen / looked_at if looked_at else 0.0

    @property
    def score(self) -> float:
        """How well the pose is borne out; for comparing poses in the same views."""
        all_points = max(self.seen + self.through + self.ahead + self.hidden, 1)
        return (self.seen - self.through - self.ahead) / all_points + self.edges


def glance(
    surface: OrientedPoints,
    windows: Sequence[ViewWindow],
    X_WO: np.ndarray,
    config: QualityConfig,
) -> float:
    """Returns a score of a pose (4, 4) by the depth at some points only; for choosing of many."""
    counts = sum((_count(surface, window, X_WO, config) for window in windows), np.zeros(4, int))
    return float((counts[0] - counts[1] - counts[2]) / max(counts.sum(), 1))


def examine(
    model: ObjectModel,
    windows: Sequence[ViewWindow],
    X_WO: np.ndarray,
    config: RigidFlowConfig,
) -> Evidence:
    """Compares the model at a pose (4, 4) with the views."""
    quality = config.quality
    counts = np.zeros(4, dtype=int)
    supported = np.zeros(len(model.support.points), dtype=bool)
    confirmed = searched = 0
    for window in windows:
        counts += _count(model.aligned, window, X_WO, quality)
        support = sample_depth(model.support, window, X_WO, quality.min_cosine)
        agrees = np.abs(support.residuals) < quality.inlier_error
        supported[support.index[agrees]] = True
        matches = match_contour(
            model.points, model.normals, model.contour_bias, window, X_WO, config.contour
        )
        if matches is not None:
            error = np.abs(matches.displacements - model.contour_bias)
            confirmed += int(np.count_nonzero(error < quality.edge_error))
            searched += matches.searched
    seen_count, through_count, ahead_count, hidden_count = counts.tolist()
    return Evidence(
        seen=seen_count,
        through=through_count,
        ahead=ahead_count,
        hidden=hidden_count,
        support=int(np.count_nonzero(supported)),
        edges=confirmed / searched if searched else 0.0,
    )


def is_borne_out(
    evidence: Evidence,
    pose: PoseEstimate,
    model: ObjectModel,
    agreement: float,
    config: QualityConfig,
) -> bool:
    """Returns whether a pose has the support that a tracked object must have.

    Without model points in sight (all hidden) there is no support, but neither is there evidence
    against the pose; then its doubt, which grows from step to step, decides.
    """
    if pose.point_deviations(model.part_points).max() > config.lost_deviation:
        return False
    if evidence.support < config.min_support:
        return evidence.through + evidence.ahead < evidence.hidden
    return evidence.agreement >= agreement


def part_confidence(
    evidence: Evidence,
    pose: PoseEstimate,
    model: ObjectModel,
    windows: Sequence[ViewWindow],
    config: QualityConfig,
) -> np.ndarray:
    """Returns the confidence (N,) in [0, 1] of the part points of a pose that is borne out.

    The product of three factors: how sure the pose is at the point, how well the views agree with
    the pose, and whether a view shows the point.
    """
    sureness = pose.point_deviations(model.part_points) / config.point_deviation
    agreement = np.clip(
        (evidence.agreement - config.lost_agreement) / (1.0 - config.lost_agreement), 0.0, 1.0
    )
    if evidence.support < config.min_support:
        agreement = 0.0
    visible = _visible(pose.X_WO, model.part_points, windows, config.visible_error)
    shown = np.where(visible, 1.0, config.hidden_confidence)
    return np.clip(np.exp(-0.5 * sureness**2) * (0.2 + 0.8 * agreement) * shown, 0.0, 1.0)


def _count(
    surface: OrientedPoints, window: ViewWindow, X_WO: np.ndarray, config: QualityConfig
) -> np.ndarray:
    """Returns how many points are seen, seen through, ahead and hidden (4,)."""
    samples = sample_depth(surface, window, X_WO, config.min_cosine)
    seen = np.abs(samples.residuals) < config.inlier_error
    through = ~seen & (samples.behind > 0.0)
    hidden = ~seen & (samples.behind < -config.hidden_error)
    ahead = ~(seen | through | hidden)
    return np.array([np.count_nonzero(x) for x in (seen, through, ahead, hidden)])


def _visible(
    X_WO: np.ndarray, points_O: np.ndarray, windows: Sequence[ViewWindow], error: float
) -> np.ndarray:
    """Returns which points (N,) bool have depth like theirs measured around their pixel."""
    visible = np.zeros(len(points_O), dtype=bool)
    for window in windows:
        points_C = window.sight(X_WO).to_camera(points_O)
        u, v = window.project(points_C)
        height, width = window.depth.shape
        u, v = np.rint(u).astype(np.intp), np.rint(v).astype(np.intp)
        inside = (u >= 1) & (v >= 1) & (u < width - 1) & (v < height - 1) & (points_C[:, 2] > 0.05)
        u, v = np.where(inside, u, 1), np.where(inside, v, 1)
        for du in (-1, 0, 1):
            for dv in (-1, 0, 1):
                behind = window.depth[v + dv, u + du] - points_C[:, 2]
                visible |= inside & (np.abs(behind) < error)
    return visible
