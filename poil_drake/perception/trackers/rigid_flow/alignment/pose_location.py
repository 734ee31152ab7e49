"""Predicts the object's pose from the tracker's state, and locates the object in a new frame."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from poil_drake.geometry.frozen_array import SharedOnCopy
from poil_drake.geometry.rigid_transform import transform_points
from poil_drake.perception.images import MultiViewFrame
from poil_drake.perception.trackers.rigid_flow.alignment.pose_alignment import (
    PoseEstimate,
    align,
    move,
)
from poil_drake.perception.trackers.rigid_flow.alignment.pose_search import SearchRegion, search
from poil_drake.perception.trackers.rigid_flow.appearance_model import observe
from poil_drake.perception.trackers.rigid_flow.config import RigidFlowConfig
from poil_drake.perception.trackers.rigid_flow.free_space import ObservedPoints
from poil_drake.perception.trackers.rigid_flow.model_growth import Keyframe
from poil_drake.perception.trackers.rigid_flow.object_model import ObjectModel
from poil_drake.perception.trackers.rigid_flow.track_quality import (
    CERTAIN_AGREEMENT,
    MAX_CONFLICT,
    RETRY_CONFLICT,
    Evidence,
    examine,
)
from poil_drake.perception.trackers.rigid_flow.view_window import ViewWindow, make_window

_MAX_INNOVATION = 3.0
"""Largest `RigidFlowState.innovation`, in standard deviations of the motion prior, after which the
object is expected to follow the motion prior in the next step."""

_VELOCITY_DAMPING = 0.95  # share of the velocity that continues in the next step
_MAX_EXTRAPOLATION = 0.5  # longest time over which the velocity is extrapolated [s]

_NEAR = (float(np.radians(20.0)), 0.025)  # initial standard deviations of a search [rad, m]
_GROWTH = (float(np.radians(20.0)), 0.03)  # their growth while the object is lost [rad/s, m/s]
_FAR = (float(np.radians(60.0)), 0.1)  # their limits [rad, m]
_FOUND = (float(np.radians(10.0)), 0.01)  # standard deviations of a pose found by search [rad, m]


@dataclass(frozen=True, eq=False)
class RigidFlowState(SharedOnCopy):
    """The tracker's knowledge after one frame, from which the next step starts.

    Attributes:
        model: The model of the object.
        keyframes: The views from which the model was learnt.
        pose: The object's pose; while it is lost, its predicted pose.
        velocity: (6,) velocity (ω [rad/s], v [m/s]) of the object in its own frame.
        stamp: Time of capture of the last frame [s].
        innovation: Difference (angle [rad], distance [m]) between the last pose and the pose that
            the motion prior predicted or, without a motion prior, the extrapolation.
        hidden_since: Time of capture of the first of the last frames that show too little of the
            object [s]; None while the views show enough of it.
        lost_since: Time of capture of the frame in which the object was lost [s]; None while it is
            tracked.
        candidate: (4, 4) the most likely pose of a lost object; None if no pose is likely.
        unconfirmed: Whether a lost object was found in the last frame, but far from where it was
            expected, so that the next frame has to confirm it.
        steps: Number of steps since the start.
    """

    model: ObjectModel
    keyframes: tuple[Keyframe, ...]
    pose: PoseEstimate
    velocity: np.ndarray
    stamp: float
    innovation: tuple[float, float] = (0.0, 0.0)
    hidden_since: float | None = None
    lost_since: float | None = None
    candidate: np.ndarray | None = None
    unconfirmed: bool = False
    steps: int = 0


class Location(NamedTuple):
    """An aligned pose, the evidence for the pose, and the windows of the views."""

    pose: PoseEstimate
    evidence: Evidence
    windows: list[ViewWindow]


def spread(angular: float, linear: float) -> np.ndarray:
    """Returns a covariance (6, 6) with the given standard deviations [rad, m] on all axes."""
    return np.diag(np.repeat(np.array([angular, linear]) ** 2, 3))


def predict(
    state: RigidFlowState,
    elapsed: float,
    motion_prior: np.ndarray | None,
    config: RigidFlowConfig,
) -> PoseEstimate:
    """Returns the predicted pose of the object in a new frame.

    The motion prior predicts the pose. If there is none, or if a tracked object did not follow the
    last prediction, the velocity is extrapolated instead.

    Args:
        state: The tracker's state after the last frame.
        elapsed: Time since the last frame [s].
        motion_prior: (4, 4) expected motion of the object in the world, or None.
        config: Parameters.
    """
    deviations = _prior_deviations(elapsed, config)
    usable = state.lost_since is not None or _follows_prior(state, elapsed, config)
    if motion_prior is not None and usable:
        X_WO = motion_prior @ state.pose.X_WO
    else:
        ahead = _VELOCITY_DAMPING * min(elapsed, _MAX_EXTRAPOLATION)
        X_WO = move(state.pose.X_WO, state.velocity * ahead)
        # The next motion may differ as much from its prediction as the last one did.
        free = np.array([config.free_angular_speed, config.free_linear_speed]) * elapsed
        deviations = np.maximum(free, state.innovation)
    noise = spread(*deviations)
    return PoseEstimate(X_WO, state.pose.prior_covariance + noise, state.pose.covariance + noise)


def _prior_deviations(elapsed: float, config: RigidFlowConfig) -> np.ndarray:
    """Returns the standard deviations (2,) [rad, m] of the error of a motion prior."""
    return np.array([config.prior_angular_speed, config.prior_linear_speed]) * elapsed


def _follows_prior(state: RigidFlowState, elapsed: float, config: RigidFlowConfig) -> bool:
    """Returns whether the object's last motion was close to its prediction."""
    limits = _MAX_INNOVATION * _prior_deviations(elapsed, config)
    return bool(np.all(state.innovation <= limits))


def locate(
    state: RigidFlowState, frame: MultiViewFrame, predicted: PoseEstimate, config: RigidFlowConfig
) -> Location:
    """Aligns the model with a frame, and returns the best location.

    The alignment of a tracked object starts from the predicted pose. If the result is not
    certain, or if the object is lost, alignments also start from the poses that `search` finds.
    """
    model = state.model
    best: Location | None = None
    if state.lost_since is None:
        best = _align(model, frame, predicted)
        followed = _follows_prior(state, frame.stamp - state.stamp, config)
        if _is_certain(best, MAX_CONFLICT if followed else RETRY_CONFLICT):
            return best
    noise = spread(*_FOUND)
    # The draw depends on the state only, so a step is reproducible, at any epoch of the stamps.
    regions = _search_regions(state, frame.stamp, predicted)
    for X_WO in search(model, frame, regions, seed=state.steps):
        other = _align(model, frame, PoseEstimate(X_WO, noise, predicted.covariance + noise))
        if best is None or other.evidence.score > best.evidence.score:
            best = other
        if _is_certain(best, RETRY_CONFLICT):
            break
    assert best is not None, "a search finds at least one pose"
    return best


def look_around(
    model: ObjectModel, frame: MultiViewFrame, X_WO: np.ndarray
) -> tuple[list[ViewWindow], ObservedPoints]:
    """Returns the windows and the observed points around the object at a pose (4, 4)."""
    points_W = transform_points(X_WO, model.surface.points)
    views = zip(frame.cameras, frame.images, strict=True)
    windows = [make_window(camera, image, points_W) for camera, image in views]
    observed = observe(model.appearance, frame, X_WO[None, :3, 3], model.radius)
    return [window for window in windows if window is not None], observed


def _align(model: ObjectModel, frame: MultiViewFrame, start: PoseEstimate) -> Location:
    windows, observed = look_around(model, frame, start.X_WO)
    pose = align(model, windows, observed, start)
    return Location(pose, examine(model, windows, observed, pose), windows)


def _is_certain(location: Location, max_conflict: float) -> bool:
    """Returns whether a location is so certain that no other pose needs to be tried."""
    evidence = location.evidence
    return evidence.supports_pose(CERTAIN_AGREEMENT) and evidence.conflict <= max_conflict


def _search_regions(
    state: RigidFlowState, stamp: float, predicted: PoseEstimate
) -> list[SearchRegion]:
    """Returns regions around the prediction, a tracked object's last pose, and the candidate."""
    missed = 0.0 if state.lost_since is None else stamp - state.lost_since
    angular, linear = (
        min(near + growth * missed, far)
        for near, growth, far in zip(_NEAR, _GROWTH, _FAR, strict=True)
    )
    regions = [SearchRegion(predicted.X_WO, angular, linear)]
    if state.lost_since is None:
        regions.append(SearchRegion(state.pose.X_WO, angular, linear))
    if state.candidate is not None:
        regions.append(SearchRegion(state.candidate, *_NEAR))
    return regions
