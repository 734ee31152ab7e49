"""The pose at which the model agrees best with the views and with its prediction."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from poil_drake.geometry.frozen_array import SharedOnCopy
from poil_drake.geometry.rigid_transform import make_transform, rotation_exp, rotation_log
from poil_drake.perception.trackers.rigid_flow.alignment.contour_term import (
    ContourMatches,
    add_contour_term,
    match_contour,
)
from poil_drake.perception.trackers.rigid_flow.alignment.depth_term import add_depth_term
from poil_drake.perception.trackers.rigid_flow.alignment.free_space_term import add_free_space_term
from poil_drake.perception.trackers.rigid_flow.alignment.normal_equations import NormalEquations
from poil_drake.perception.trackers.rigid_flow.alignment.texture_term import (
    PatchMatches,
    add_flow_term,
    add_texture_term,
    match_patches,
    select_shown,
)
from poil_drake.perception.trackers.rigid_flow.appearance_model import ObservedPoints
from poil_drake.perception.trackers.rigid_flow.config import RigidFlowConfig
from poil_drake.perception.trackers.rigid_flow.object_model import ObjectModel
from poil_drake.perception.trackers.rigid_flow.texture_patches import TexturePatches
from poil_drake.perception.trackers.rigid_flow.view_window import ViewWindow


@dataclass(frozen=True, eq=False)
class PoseEstimate(SharedOnCopy):
    """A pose and how sure it is.

    Attributes:
        X_WO: (4, 4) pose of the object.
        covariance: (6, 6) of its error (ω [rad], v [m]) in the object's frame, which the next
            alignment is held by. Along what the data do not tell, it takes their noise for
            information, which keeps the pose from being driven about by that noise.
        doubt: (6, 6) likewise, but without that: how far off the pose may really be.
    """

    X_WO: np.ndarray
    covariance: np.ndarray
    doubt: np.ndarray

    def point_deviations(self, points_O: np.ndarray) -> np.ndarray:
        """Returns how far off points (N, 3) of the object may be: (N,) standard deviations [m]."""
        lever = np.zeros((len(points_O), 3, 6))
        lever[:, :, 3:] = np.eye(3)
        x, y, z = points_O.T
        lever[:, 0, 1], lever[:, 0, 2] = z, -y
        lever[:, 1, 0], lever[:, 1, 2] = -z, x
        lever[:, 2, 0], lever[:, 2, 1] = y, -x
        return np.sqrt(np.einsum("nik,kl,nil->n", lever, self.doubt, lever))


def align(
    model: ObjectModel,
    windows: Sequence[ViewWindow],
    around: ObservedPoints,
    predicted: PoseEstimate,
    config: RigidFlowConfig,
) -> PoseEstimate:
    """Aligns the model with the views by robust Gauss-Newton steps.

    Args:
        model: The object.
        windows: The views in which it may be seen.
        around: What is around it and is its own by its colour.
        predicted: Where it is expected; the alignment starts there.
        config: Parameters.

    Returns:
        The pose with what the data and the prediction leave of its uncertainty.
    """
    X = predicted.X_WO
    held_by = np.linalg.inv(predicted.covariance)
    views = [_View(window) for window in windows]
    last = len(config.depth.gates) - 1
    k = 0
    while True:
        equations = NormalEquations()
        for view in views:
            view.add_to(equations, model, X, k, k == last, config)
        add_free_space_term(equations, model.appearance, around, X, model.radius, config.appearance)
        deviation = motion_between(predicted.X_WO, X)
        # Student's t in place of a normal distribution: a large deviation loosens its own hold.
        freedom = config.motion.robustness
        hold = (freedom + 6.0) / (freedom + deviation @ held_by @ deviation)
        H = equations.H + hold * held_by
        step = np.linalg.solve(H, equations.b - hold * (held_by @ deviation))
        X = move(X, step)
        if k == last:
            break
        # Nothing moves any more: only the last iteration, with its gates, remains.
        k = last if _is_small(step, config) and k >= config.texture.search_iterations else k + 1
    told = equations.information(model.radius) / config.quality.optimism
    doubt = np.linalg.inv(np.linalg.inv(predicted.doubt) + told)
    return PoseEstimate(X, np.linalg.inv(H), doubt)


def move(X_WO: np.ndarray, motion: np.ndarray) -> np.ndarray:
    """Returns a pose (4, 4) moved by (ω, v) (6,) in the object's own frame."""
    R = X_WO[:3, :3]
    return make_transform(R @ rotation_exp(motion[:3]), X_WO[:3, 3] + R @ motion[3:])


def motion_between(X_from: np.ndarray, X_to: np.ndarray) -> np.ndarray:
    """Returns the motion (6,) that takes one pose (4, 4) to another: the inverse of `move`."""
    R = X_from[:3, :3]
    turn = rotation_log(R.T @ X_to[:3, :3])
    return np.concatenate([turn, R.T @ (X_to[:3, 3] - X_from[:3, 3])])


def _is_small(step: np.ndarray, config: RigidFlowConfig) -> bool:
    motion = config.motion
    return bool(
        np.linalg.norm(step[:3]) < motion.settled_angular
        and np.linalg.norm(step[3:]) < motion.settled_linear
    )


class _View:
    """One view during an alignment: what was found in it stays in use for some iterations."""

    def __init__(self, window: ViewWindow):
        self._window = window
        self._outline: ContourMatches | None = None
        self._flow: PatchMatches | None = None
        self._shown: TexturePatches | None = None

    def add_to(
        self,
        equations: NormalEquations,
        model: ObjectModel,
        X: np.ndarray,
        k: int,
        final: bool,
        config: RigidFlowConfig,
    ) -> None:
        """Adds the terms of iteration k at pose X (4, 4)."""
        window, contour, texture = self._window, config.contour, config.texture
        gate = config.depth.gates[k]
        add_depth_term(equations, model.aligned, window, X, gate, config.depth, final=final)
        if k in contour.search_iterations:
            self._outline = match_contour(
                model.points, model.normals, model.contour_bias, window, X, contour
            )
        if self._outline is not None:
            gate = contour.gates[k]
            add_contour_term(equations, self._outline, window, X, gate, contour, final=final)
        if len(model.patches) == 0:
            return
        # First patches are searched, then grey levels are compared.
        if self._shown is None or k == texture.search_iterations:
            self._shown = select_shown(model.patches, window, X, texture)
        if k == 0 and texture.search_iterations > 0:
            self._flow = match_patches(self._shown, window, X, texture)
        if k >= texture.search_iterations:
            least = texture.min_correlations[k]
            add_texture_term(equations, self._shown, window, X, least, texture)
        elif self._flow is not None:
            add_flow_term(equations, self._flow, window, X, texture)
