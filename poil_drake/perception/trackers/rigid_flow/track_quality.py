"""Whether the views bear a pose out, and how far the points are to be believed."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from poil_drake.perception.trackers.rigid_flow.alignment.contour_term import (
    ContourMatches,
    match_contour,
)
from poil_drake.perception.trackers.rigid_flow.alignment.depth_term import (
    OrientedPoints,
    sample_depth,
)
from poil_drake.perception.trackers.rigid_flow.alignment.pose_alignment import PoseEstimate
from poil_drake.perception.trackers.rigid_flow.appearance_model import (
    ObservedPoints,
    contradiction,
    likeness,
)
from poil_drake.perception.trackers.rigid_flow.config import QualityConfig, RigidFlowConfig
from poil_drake.perception.trackers.rigid_flow.object_model import ObjectModel
from poil_drake.perception.trackers.rigid_flow.view_window import ViewWindow

_AHEAD_WEIGHT = 0.5  # against 1 for points that the camera sees through
_VACANT_WEIGHT = 8.0  # few pixels show a handle, but they tell much


@dataclass(frozen=True, eq=False)
class Evidence:
    """What the views say about a pose, in numbers of model points that should be seen.

    Attributes:
        seen: Measured depth agrees.
        other: Those of them whose colour is another.
        through: Measured depth is farther: the camera sees through where the object should be.
        ahead: Something is a little nearer: a wrong pose, or a thing that touches the object.
        hidden: Something is much nearer and hides the object.
        support: How many of the support points some view shows.
        edges: Share of the outline, where nothing hides it, whose edge is where it should be.
        vacant: Share of what is around, and is the object's by its colour, that lies where the
            object is known not to be.
        enough: With fewer points to look at, a pose is borne out the less.
    """

    seen: int
    other: int
    through: int
    ahead: int
    hidden: int
    support: int
    edges: float
    vacant: float
    enough: int

    @property
    def agreement(self) -> float:
        """The share of points that agree, of those that nothing hides; 0 where there are none."""
        return self.seen / (self.seen + self.against) if self.seen else 0.0

    @property
    def against(self) -> float:
        """How many points speak against the pose; what is ahead may be a thing that touches."""
        return self.through + _AHEAD_WEIGHT * self.ahead

    @property
    def looked_at(self) -> int:
        """How many points nothing hides."""
        return self.seen + self.through + self.ahead

    @property
    def score(self) -> float:
        """How well the pose is borne out; for comparing poses in the same views."""
        all_points = max(self.looked_at + self.hidden, self.enough)
        points = (self.seen - 2 * self.other - self.against) / all_points
        return points + self.edges - _VACANT_WEIGHT * self.vacant


def examine(
    model: ObjectModel,
    windows: Sequence[ViewWindow],
    around: ObservedPoints,
    X_WO: np.ndarray,
    config: RigidFlowConfig,
) -> Evidence:
    """Compares the model at a pose (4, 4) with the views, and with what is around it by colour."""
    quality = config.quality
    counts = np.zeros(5, dtype=int)
    supported = np.zeros(len(model.support.points), dtype=bool)
    confirmed = searched = 0
    for window in windows:
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
        counts += _count(model.aligned, window, X_WO, matches, config)
    seen_count, other_count, through_count, ahead_count, hidden_count = counts.tolist()
    explained, vacant = contradiction(
        model.appearance, around, X_WO[None], model.radius, config.appearance
    )
    return Evidence(
        seen=seen_count,
        other=other_count,
        through=through_count,
        ahead=ahead_count,
        hidden=hidden_count,
        support=int(np.count_nonzero(supported)),
        edges=confirmed / searched if searched else 0.0,
        enough=round(quality.enough_points * len(model.aligned.points)),
        vacant=float(vacant[0] / (explained[0] + vacant[0] + config.appearance.few_observed)),
    )


def is_borne_out(
    evidence: Evidence,
    pose: PoseEstimate,
    model: ObjectModel,
    agreement: float,
    config: QualityConfig,
) -> bool:
    """Returns whether a pose has the support that a tracked object must have.

    With nearly all model points hidden there is no support, but neither is there evidence against
    the pose; then its doubt, which grows from step to step, decides.
    """
    if pose.point_deviations(model.part_points).max() > config.lost_deviation:
        return False
    if not _is_supported(evidence, config):
        return evidence.looked_at < config.hidden_share * (evidence.looked_at + evidence.hidden)
    return evidence.agreement >= agreement and evidence.vacant <= config.max_vacant


def is_found(
    evidence: Evidence, pose: PoseEstimate, model: ObjectModel, config: QualityConfig
) -> bool:
    """Returns whether a pose is so well borne out that an object that was lost is there."""
    sure = pose.point_deviations(model.part_points).max() <= config.found_deviation
    return bool(
        sure
        and _is_supported(evidence, config)
        and evidence.looked_at >= evidence.enough
        and evidence.agreement >= config.found_agreement
        and evidence.vacant <= config.max_vacant
    )


def part_confidence(
    evidence: Evidence,
    pose: PoseEstimate,
    model: ObjectModel,
    windows: Sequence[ViewWindow],
    config: QualityConfig,
) -> np.ndarray:
    """Returns the confidence (N,) in [0, 1] of the part points of a pose that is borne out.

    The product of four factors: how sure the pose is at the point, how well the views agree with
    the pose, how little they contradict it, and whether a view shows the point.
    """
    sureness = pose.point_deviations(model.part_points) / config.point_deviation
    agreement = np.clip(
        (evidence.agreement - config.lost_agreement) / (1.0 - config.lost_agreement), 0.0, 1.0
    )
    if not _is_supported(evidence, config):
        agreement = 0.0
    visible = _visible(pose.X_WO, model.part_points, windows, config.visible_error)
    shown = np.where(visible, 1.0, config.hidden_confidence)
    unopposed = np.clip(1.0 - evidence.vacant / config.max_vacant, 0.1, 1.0)
    belief = (0.2 + 0.8 * agreement) * unopposed * shown
    return np.clip(np.exp(-0.5 * sureness**2) * belief, 0.0, 1.0)


def _is_supported(evidence: Evidence, config: QualityConfig) -> bool:
    """Returns whether enough of the object is seen: points all over it, or many at one place."""
    return evidence.support >= config.min_support or evidence.seen >= evidence.enough


def _count(
    surface: OrientedPoints,
    window: ViewWindow,
    X_WO: np.ndarray,
    matches: ContourMatches | None,
    config: RigidFlowConfig,
) -> np.ndarray:
    """Returns how many points are seen, of other colour, seen through, ahead and hidden (5,)."""
    quality = config.quality
    samples = sample_depth(surface, window, X_WO, quality.min_cosine)
    u, v = samples.pixels
    near = np.abs(samples.residuals) < quality.inlier_error
    shown = near.copy()
    if matches is not None:
        # What the object itself hides tells nothing.
        z = window.depth[v, u] - samples.behind
        shown |= z < matches.rendering[v, u] + quality.self_hidden
    own = surface.features[:, samples.index]
    alike = likeness(window.rgb[v, u], own, config.appearance) > 0.0
    through = ~near & (samples.behind > 0.0)
    hidden = ~near & (samples.behind < -quality.hidden_error)
    ahead = ~(near | through | hidden)
    kinds = (near, near & ~alike, through, ahead, hidden)
    return np.array([np.count_nonzero(kind & shown) for kind in kinds])


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
