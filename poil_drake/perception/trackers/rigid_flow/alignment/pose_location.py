"""Where the object is expected in a frame, and where it is found."""

from typing import NamedTuple

import numpy as np

from poil_drake.geometry.rigid_transform import transform_points
from poil_drake.perception.images import MultiViewFrame
from poil_drake.perception.trackers.rigid_flow.alignment.pose_alignment import (
    PoseEstimate,
    align,
    move,
)
from poil_drake.perception.trackers.rigid_flow.alignment.pose_search import Guess, search
from poil_drake.perception.trackers.rigid_flow.appearance_model import observe
from poil_drake.perception.trackers.rigid_flow.config import (
    MotionConfig,
    RigidFlowConfig,
    SearchConfig,
)
from poil_drake.perception.trackers.rigid_flow.object_model import ObjectModel
from poil_drake.perception.trackers.rigid_flow.state import RigidFlowState
from poil_drake.perception.trackers.rigid_flow.track_quality import Evidence, examine, is_borne_out
from poil_drake.perception.trackers.rigid_flow.view_window import ViewWindow, make_window

_DRAW_STEP = 1e-3  # frames this far apart are searched with other poses [s]


class Location(NamedTuple):
    """A pose that was aligned with the views, what they say about it, and their windows."""

    pose: PoseEstimate
    evidence: Evidence
    windows: list[ViewWindow]


def predict(
    state: RigidFlowState,
    elapsed: float,
    motion_prior: np.ndarray | None,
    config: RigidFlowConfig,
) -> PoseEstimate:
    """Returns where the object is expected, and how surely.

    Args:
        state: Where the tracker stands.
        elapsed: Since the last frame [s].
        motion_prior: (4, 4) expected motion in the world, or None.
        config: Parameters.
    """
    motion = config.motion
    angular, linear = motion.prior_angular * elapsed, motion.prior_linear * elapsed
    obeyed = _is_obedient(state, elapsed, motion)
    if motion_prior is not None and (obeyed or state.lost_since is not None):
        X_WO = motion_prior @ state.pose.X_WO
    else:
        ahead = motion.velocity_damping * min(elapsed, motion.max_extrapolation)
        X_WO = move(state.pose.X_WO, state.velocity * ahead)
        # A motion that was off once may be as far off again.
        angular = max(motion.free_angular * elapsed, state.innovation[0])
        linear = max(motion.free_linear * elapsed, state.innovation[1])
    spread = np.diag(np.repeat(np.array([angular, linear]) ** 2, 3))
    return PoseEstimate(X_WO, state.pose.covariance + spread, state.pose.doubt + spread)


def _is_obedient(state: RigidFlowState, elapsed: float, motion: MotionConfig) -> bool:
    """Returns whether the last motion was about as expected."""
    angular, linear = motion.prior_angular * elapsed, motion.prior_linear * elapsed
    return (
        state.innovation[0] <= motion.disobedience * angular
        and state.innovation[1] <= motion.disobedience * linear
    )


def _windows(
    model: ObjectModel, frame: MultiViewFrame, X_WO: np.ndarray, config: RigidFlowConfig
) -> list[ViewWindow]:
    """Returns the windows around the object of the views that it may be seen in."""
    points_W = transform_points(X_WO, model.points)
    windows = [
        make_window(index, camera, image, points_W, config.window)
        for index, (camera, image) in enumerate(zip(frame.cameras, frame.images, strict=True))
    ]
    return [window for window in windows if window is not None]


def locate(
    state: RigidFlowState, frame: MultiViewFrame, predicted: PoseEstimate, config: RigidFlowConfig
) -> Location:
    """Aligns from the prediction, and where that fails from poses found by search."""
    model, sizes = state.model, config.search
    best: Location | None = None
    if state.lost_since is None:
        best = _align(model, frame, predicted, config)
        obedient = _is_obedient(state, frame.stamp - state.stamp, config.motion)
        if _is_beyond_doubt(best, model, config, obedient=obedient):
            return best
    spread = np.diag(np.repeat(np.array([sizes.aligned_angular, sizes.aligned_linear]) ** 2, 3))
    guesses = _guesses(state, frame.stamp, predicted, sizes)
    # Each frame draws other poses, and the same frame the same.
    draw = abs(round(frame.stamp / _DRAW_STEP))
    for X_WO in search(model, frame, guesses, draw, config):
        start = PoseEstimate(X_WO, spread, predicted.doubt + spread)
        other = _align(model, frame, start, config)
        if best is None or other.evidence.score > best.evidence.score:
            best = other
        if _is_beyond_doubt(best, model, config, obedient=False):
            break
    assert best is not None, "a search finds at least one pose"
    return best


def _is_beyond_doubt(
    location: Location, model: ObjectModel, config: RigidFlowConfig, *, obedient: bool
) -> bool:
    """Returns whether no other pose need be tried; an object that moved as expected gets credit."""
    quality = config.quality
    pose, evidence, _ = location
    credit = quality.max_vacant if obedient else quality.retry_vacant
    borne_out = is_borne_out(evidence, pose, model, quality.retry_agreement, quality)
    return borne_out and evidence.vacant <= credit


def _align(
    model: ObjectModel, frame: MultiViewFrame, start: PoseEstimate, config: RigidFlowConfig
) -> Location:
    """Aligns the model from one pose."""
    windows = _windows(model, frame, start.X_WO, config)
    around = observe(
        model.appearance, frame, start.X_WO[None, :3, 3], model.radius, config.appearance
    )
    pose = align(model, windows, around, start, config)
    return Location(pose, examine(model, windows, around, pose.X_WO, config), windows)


def _guesses(
    state: RigidFlowState, stamp: float, predicted: PoseEstimate, sizes: SearchConfig
) -> list[Guess]:
    """Returns where to search: around what was expected, what was last seen, and the guess."""
    missed = 0.0 if state.lost_since is None else stamp - state.lost_since
    angular = min(sizes.near_angular + sizes.growth_angular * missed, sizes.far_angular)
    linear = min(sizes.near_linear + sizes.growth_linear * missed, sizes.far_linear)
    guesses = [Guess(predicted.X_WO, angular, linear)]
    if state.lost_since is None:
        guesses.append(Guess(state.pose.X_WO, angular, linear))
    if state.guess is not None:
        guesses.append(Guess(state.guess, sizes.near_angular, sizes.near_linear))
    return guesses
