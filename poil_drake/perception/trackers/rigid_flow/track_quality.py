"""Whether the views support a pose, and how reliable the reported points are."""

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
from poil_drake.perception.trackers.rigid_flow.appearance_model import color_similarity
from poil_drake.perception.trackers.rigid_flow.free_space import FEW_OBSERVED, ObservedPoints
from poil_drake.perception.trackers.rigid_flow.object_model import ObjectModel
from poil_drake.perception.trackers.rigid_flow.view_window import PosedView, ViewWindow

MIN_COSINE = 0.4
"""Least cosine between the normal of a compared model point and the line of sight."""

OCCLUDED_ERROR = 0.03
"""A model point this far behind the measured depth is occluded by something else [m]."""

ENOUGH_SHARE = 0.1
"""A pose scores less if fewer than this share of the model points can be compared in the views."""

MAX_CONFLICT = 0.04
"""Largest share of observed points that lie in free space at an accepted pose."""

RETRY_CONFLICT = 0.02
"""Above this share of observed points in free space, the model does not grow, and other poses are
tried. After a motion close to its prediction, other poses are tried only above `MAX_CONFLICT`."""

LOST_AGREEMENT = 0.7
"""If `Evidence.agreement` is lower, the object is lost."""

CERTAIN_AGREEMENT = 0.85
"""If `Evidence.agreement` is lower, other poses are tried, a lost object stays lost, and the model
does not grow."""

_LOST_DEVIATION = 0.025  # standard deviation of a part point above which the object is lost [m]
_FOUND_DEVIATION = 0.01  # the same, up to which a lost object can be found [m]
_LEARN_DEVIATION = 0.006  # the same, below which the model may grow [m]

_SEEN_ERROR = 0.006  # a model point with the surface measured within this is seen [m]
_SELF_OCCLUDED = 0.008  # a point this far behind the rendered model is behind the object [m]
_EDGE_ERROR = 2.5  # an outline pixel with its edge found within this is confirmed [px]
_MIN_SUPPORT = 4  # support points that must be seen, in all views together
_OCCLUDED_SHARE = 0.1  # with less of it unoccluded, the object counts as hidden, not as gone

_IN_FRONT_WEIGHT = 0.5  # against 1 for points that the camera sees through
_CONFLICT_WEIGHT = 8.0  # few pixels show a handle, but they matter

_POINT_DEVIATION = 0.01  # of a part point with confidence 0.6 [m]
_VISIBLE_ERROR = 0.01  # a part point with depth measured within this is visible [m]
_HIDDEN_CONFIDENCE = 0.6  # factor on the confidence of a part point that no view shows


@dataclass(frozen=True, eq=False)
class Evidence:
    """How well a pose agrees with the views.

    The first five attributes are numbers of model points, summed over the views that should show
    them.

    Attributes:
        seen: Points that lie on the measured surface.
        other_color: Seen points whose colour differs.
        seen_through: Points that the camera sees through.
        in_front: Points with something a little nearer to the camera. Either the pose is wrong, or
            something touches the object.
        occluded: Points with something much nearer to the camera.
        enough: Number of compared points below which the pose scores less.
        support: Number of the model's support points that any view shows.
        edges: Share of the unoccluded outline pixels near which the views show a depth edge.
        conflict: Share of the observed points around the object that lie in free space.
        deviation: Largest standard deviation of a part point [m].
    """

    seen: int
    other_color: int
    seen_through: int
    in_front: int
    occluded: int
    enough: int
    support: int
    edges: float
    conflict: float
    deviation: float

    @property
    def against(self) -> float:
        """The weighted number of points that contradict the pose."""
        return self.seen_through + _IN_FRONT_WEIGHT * self.in_front

    @property
    def agreement(self) -> float:
        """The share of seen points among all seen and contradicting points; 0 if none is seen."""
        return self.seen / (self.seen + self.against) if self.seen else 0.0

    @property
    def unoccluded(self) -> int:
        """The number of points that nothing occludes."""
        return self.seen + self.seen_through + self.in_front

    @property
    def score(self) -> float:
        """The support of the views for the pose, for comparing poses in the same views."""
        all_points = max(self.unoccluded + self.occluded, self.enough)
        points = (self.seen - 2 * self.other_color - self.against) / all_points
        return points + self.edges - _CONFLICT_WEIGHT * self.conflict

    @property
    def is_supported(self) -> bool:
        """Whether the views show enough of the object: points all over it, or many in one place."""
        return self.support >= _MIN_SUPPORT or self.seen >= self.enough

    def supports_pose(self, agreement: float) -> bool:
        """Returns whether the pose of a tracked object is accepted.

        If nearly all model points are occluded, the views neither support nor contradict the pose.
        Then only `deviation` decides, which grows from step to step.

        Args:
            agreement: The least agreement of an accepted pose.
        """
        if self.deviation > _LOST_DEVIATION:
            return False
        if not self.is_supported:
            return self.unoccluded < _OCCLUDED_SHARE * (self.unoccluded + self.occluded)
        return self.agreement >= agreement and self.conflict <= MAX_CONFLICT

    @property
    def is_found(self) -> bool:
        """Whether the views support the pose so well that a lost object is found there."""
        return (
            self.deviation <= _FOUND_DEVIATION
            and self.is_supported
            and self.unoccluded >= self.enough
            and self.agreement >= CERTAIN_AGREEMENT
            and self.conflict <= MAX_CONFLICT
        )

    @property
    def may_learn(self) -> bool:
        """Whether the pose is certain enough for the model to grow."""
        return (
            self.deviation < _LEARN_DEVIATION
            and self.support >= _MIN_SUPPORT
            and self.agreement >= CERTAIN_AGREEMENT
            and self.conflict <= RETRY_CONFLICT
        )


def examine(
    model: ObjectModel,
    windows: Sequence[ViewWindow],
    observed: ObservedPoints,
    pose: PoseEstimate,
) -> Evidence:
    """Compares the model at a pose with the views and with the observed points around the pose."""
    counts = np.zeros(5, dtype=int)
    supported = np.zeros(len(model.support), dtype=bool)
    confirmed = searched = 0
    for window in windows:
        view = window.at(pose.X_WO)
        support = sample_depth(model.support, view, MIN_COSINE)
        supported[support.index[np.abs(support.residuals) < _SEEN_ERROR]] = True
        matches = match_contour(model.surface, model.contour_bias, view)
        if matches is not None:
            error = np.abs(matches.displacements - model.contour_bias)
            confirmed += int(np.count_nonzero(error < _EDGE_ERROR))
            searched += matches.searched
        counts += _count(model.aligned, view, matches)
    explained, conflicting = model.appearance.free_space.conflict(
        observed, pose.X_WO[None], model.radius
    )
    seen, other_color, seen_through, in_front, occluded = counts.tolist()
    return Evidence(
        seen=seen,
        other_color=other_color,
        seen_through=seen_through,
        in_front=in_front,
        occluded=occluded,
        enough=round(ENOUGH_SHARE * len(model.aligned)),
        support=int(np.count_nonzero(supported)),
        edges=confirmed / searched if searched else 0.0,
        conflict=float(conflicting[0] / (explained[0] + conflicting[0] + FEW_OBSERVED)),
        deviation=float(pose.point_deviations(model.part_points).max()),
    )


def part_confidence(
    evidence: Evidence, pose: PoseEstimate, model: ObjectModel, windows: Sequence[ViewWindow]
) -> np.ndarray:
    """Returns the confidence (N,) in [0, 1] in each part point at an accepted pose.

    It is the product of four factors: the certainty of the point's position, the agreement of the
    views with the pose, the absence of conflict, and whether a view shows the point.
    """
    deviations = pose.point_deviations(model.part_points) / _POINT_DEVIATION
    agreement = np.clip((evidence.agreement - LOST_AGREEMENT) / (1.0 - LOST_AGREEMENT), 0.0, 1.0)
    if not evidence.is_supported:
        agreement = 0.0
    visible = np.any([_is_visible(w.at(pose.X_WO), model.part_points) for w in windows], axis=0)
    shown = np.where(visible, 1.0, _HIDDEN_CONFIDENCE)
    unopposed = np.clip(1.0 - evidence.conflict / MAX_CONFLICT, 0.1, 1.0)
    factor = (0.2 + 0.8 * agreement) * unopposed * shown
    return np.clip(np.exp(-0.5 * deviations**2) * factor, 0.0, 1.0)


def _count(surface: OrientedPoints, view: PosedView, matches: ContourMatches | None) -> np.ndarray:
    """Returns the first five counts of `Evidence`, (5,), for one view."""
    window = view.window
    samples = sample_depth(surface, view, MIN_COSINE)
    u, v = samples.pixels
    near = np.abs(samples.residuals) < _SEEN_ERROR
    shown = near.copy()
    if matches is not None:
        # Points that the object itself occludes do not count.
        z = window.depth[v, u] - samples.behind
        shown |= z < matches.rendering[v, u] + _SELF_OCCLUDED
    similar = color_similarity(window.rgb[v, u], surface.features[samples.index]) > 0.0
    through = ~near & (samples.behind > 0.0)
    occluded = ~near & (samples.behind < -OCCLUDED_ERROR)
    in_front = ~(near | through | occluded)
    kinds = (near, near & ~similar, through, in_front, occluded)
    return np.array([np.count_nonzero(kind & shown) for kind in kinds])


def _is_visible(view: PosedView, points_O: np.ndarray) -> np.ndarray:
    """Returns which points (N,) bool agree with the depth measured in or beside their pixel."""
    points_C = view.to_camera(points_O)
    u, v = (np.rint(x).astype(np.intp) for x in view.window.project(points_C))
    height, width = view.window.depth.shape
    inside = (u >= 1) & (v >= 1) & (u < width - 1) & (v < height - 1) & (points_C[:, 2] > 0.05)
    u, v = np.where(inside, u, 1), np.where(inside, v, 1)
    rows, columns = v[:, None, None] + [[-1], [0], [1]], u[:, None, None] + [-1, 0, 1]
    error = np.abs(view.window.depth[rows, columns] - points_C[:, 2, None, None])
    return inside & (error < _VISIBLE_ERROR).any(axis=(1, 2))
