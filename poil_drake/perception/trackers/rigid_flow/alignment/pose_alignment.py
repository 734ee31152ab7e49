"""Finds the pose at which the model agrees best with the views and with the predicted pose."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from poil_drake.geometry.frozen_array import SharedOnCopy
from poil_drake.geometry.rigid_transform import make_transform, rotation_exp, rotation_log, skew
from poil_drake.perception.trackers.rigid_flow.alignment.contour_term import (
    ContourMatches,
    add_contour_term,
    match_contour,
)
from poil_drake.perception.trackers.rigid_flow.alignment.depth_term import add_depth_term
from poil_drake.perception.trackers.rigid_flow.alignment.normal_equations import NormalEquations
from poil_drake.perception.trackers.rigid_flow.alignment.texture_term import (
    PatchMatches,
    add_flow_term,
    add_texture_term,
    match_patches,
    select_shown,
)
from poil_drake.perception.trackers.rigid_flow.free_space import (
    ObservedPoints,
    add_free_space_term,
)
from poil_drake.perception.trackers.rigid_flow.object_model import ObjectModel
from poil_drake.perception.trackers.rigid_flow.texture_patches import TexturePatches
from poil_drake.perception.trackers.rigid_flow.view_window import ViewWindow


class _Iteration(NamedTuple):
    """How one Gauss-Newton step weighs its residuals.

    Attributes:
        depth_gate: Larger depth residuals do not count [m].
        contour_gate: Larger contour residuals do not count [px].
        min_correlation: Patches that correlate less with the image do not count. It is 0 in steps
            that search for patches instead (`add_flow_term`).
        match_contour: Whether edges are searched for, which requires a rendering of the model.
    """

    depth_gate: float
    contour_gate: float
    min_correlation: float
    match_contour: bool = False


_ITERATIONS = (
    _Iteration(0.02, 10.0, 0.0, match_contour=True),
    _Iteration(0.015, 8.0, 0.0),
    _Iteration(0.01, 6.0, 0.5),
    _Iteration(0.008, 5.0, 0.6, match_contour=True),
    _Iteration(0.006, 4.0, 0.6),
    _Iteration(0.006, 4.0, 0.6),
)
_FLOW_ITERATIONS = 2  # number of first iterations, in which patches are searched for

_SETTLED = (float(np.radians(0.25)), 3e-4)
"""Smaller steps end the alignment [rad, m]. Each step is about half as long as the one before, so
the remaining error is below the views' noise."""

_FREEDOM = 4.0
"""Degrees of freedom of the prediction's error, which has a Student-t distribution. With fewer,
the views overrule the prediction more readily, e.g. when the object slips or is pushed."""

_OPTIMISM = 5.0
"""Factor by which the views seem to give more information than they do, because errors of the model
repeat from frame to frame. It was measured by comparing errors with standard deviations."""


@dataclass(frozen=True, eq=False)
class PoseEstimate(SharedOnCopy):
    """A pose with its uncertainty.

    Attributes:
        X_WO: (4, 4) pose of the object.
        prior_covariance: (6, 6) covariance of the error (ω [rad], v [m]) in the object's frame, for
            use by the next alignment. It includes spurious information (see `NormalEquations`),
            which keeps the pose from drifting in directions that the views do not determine.
        covariance: (6, 6) covariance of the same error, without spurious information.
    """

    X_WO: np.ndarray
    prior_covariance: np.ndarray
    covariance: np.ndarray

    def point_deviations(self, points_O: np.ndarray) -> np.ndarray:
        """Returns the standard deviations (N,) [m] of points' positions (N, 3) [m, object]."""
        identity = np.broadcast_to(np.eye(3), (len(points_O), 3, 3))
        jacobian = np.concatenate([-skew(points_O), identity], axis=2)
        return np.sqrt(np.einsum("nik,kl,nil->n", jacobian, self.covariance, jacobian))


def align(
    model: ObjectModel,
    windows: Sequence[ViewWindow],
    observed: ObservedPoints,
    predicted: PoseEstimate,
) -> PoseEstimate:
    """Aligns the model with the views by robust Gauss-Newton steps.

    Args:
        model: The model of the object.
        windows: The windows of the views that may show the object.
        observed: Points around the object that have its colours.
        predicted: The predicted pose of the object, at which the alignment starts.

    Returns:
        The aligned pose, with the uncertainty that the views and the prediction leave.
    """
    X = predicted.X_WO
    prior = np.linalg.inv(predicted.prior_covariance)
    views = [_View(window) for window in windows]
    last = len(_ITERATIONS) - 1
    k = 0
    while True:
        equations = NormalEquations()
        for view in views:
            view.add_to(equations, model, X, k)
        add_free_space_term(equations, model.appearance.free_space, observed, X, model.radius)
        deviation = motion_between(predicted.X_WO, X)
        # Student's t instead of a normal distribution: a large deviation weakens the prior.
        weight = (_FREEDOM + 6.0) / (_FREEDOM + deviation @ prior @ deviation)
        H = equations.H + weight * prior
        step = np.linalg.solve(H, equations.b - weight * (prior @ deviation))
        X = move(X, step)
        if k == last:
            break
        # Once the pose has settled, skip to the last iteration, which has the narrowest gates.
        settled = np.linalg.norm(step[:3]) < _SETTLED[0] and np.linalg.norm(step[3:]) < _SETTLED[1]
        k = last if settled and k >= _FLOW_ITERATIONS else k + 1
    information = equations.information(model.radius) / _OPTIMISM
    covariance = np.linalg.inv(np.linalg.inv(predicted.covariance) + information)
    return PoseEstimate(X, np.linalg.inv(H), covariance)


def move(X_WO: np.ndarray, motion: np.ndarray) -> np.ndarray:
    """Returns a pose (4, 4), moved by (ω [rad], v [m]) (6,) in the object's own frame."""
    R = X_WO[:3, :3]
    return make_transform(R @ rotation_exp(motion[:3]), X_WO[:3, 3] + R @ motion[3:])


def motion_between(X_from: np.ndarray, X_to: np.ndarray) -> np.ndarray:
    """Returns the motion (6,) by which `move` takes pose X_from (4, 4) to pose X_to (4, 4)."""
    R = X_from[:3, :3]
    turn = rotation_log(R.T @ X_to[:3, :3])
    return np.concatenate([turn, R.T @ (X_to[:3, 3] - X_from[:3, 3])])


class _View:
    """One view during an alignment; keeps its matches over several iterations."""

    def __init__(self, window: ViewWindow):
        self._window = window
        self._contour: ContourMatches | None = None
        self._flow: PatchMatches | None = None
        self._patches = TexturePatches.empty()

    def add_to(self, equations: NormalEquations, model: ObjectModel, X: np.ndarray, k: int) -> None:
        """Adds the terms of this view in iteration k, with the object at pose X (4, 4)."""
        view, iteration, final = self._window.at(X), _ITERATIONS[k], k == len(_ITERATIONS) - 1
        add_depth_term(equations, model.aligned, view, iteration.depth_gate, final=final)
        if iteration.match_contour:
            self._contour = match_contour(model.surface, model.contour_bias, view)
        if self._contour is not None:
            add_contour_term(equations, self._contour, view, iteration.contour_gate, final=final)
        if k in (0, _FLOW_ITERATIONS):
            self._patches = select_shown(model.patches, view)
        if k == 0:
            self._flow = match_patches(self._patches, view)
        if k >= _FLOW_ITERATIONS:
            add_texture_term(equations, self._patches, view, iteration.min_correlation)
        elif self._flow is not None:
            add_flow_term(equations, self._flow, view)
