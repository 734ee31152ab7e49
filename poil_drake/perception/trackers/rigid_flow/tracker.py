"""The default tracker: aligns a model of the object, learnt from the views, with each frame.

It needs neither network weights nor a given model, runs on one core, and tracks plain objects as
well as textured ones. The model that it learns is a cloud of oriented surface points and small
patches of texture (`object_model`). In each frame it aligns the model with all views at once
(`pose_alignment`), by depth, contour and texture, starting from a prediction: the motion of the
hand that holds the object, or constant velocity. All three terms compare with the first view of a
surface, never with the previous frame, so errors do not accumulate from frame to frame. If the
alignment fails, many poses are searched (`pose_search`), in each frame until the object is found.
A pose is accepted only if the space around it does not contradict it (`free_space`).
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import compress

import numpy as np

from poil_drake.errors import InvalidValueError
from poil_drake.geometry.frozen_array import frozen_array
from poil_drake.geometry.rigid_transform import inverse, transform_points
from poil_drake.perception.images import MultiViewFrame
from poil_drake.perception.tracked_points import TrackedPoints
from poil_drake.perception.trackers.protocol import TrackerOutput
from poil_drake.perception.trackers.rigid_flow.alignment.pose_alignment import (
    PoseEstimate,
    motion_between,
)
from poil_drake.perception.trackers.rigid_flow.alignment.pose_location import (
    Location,
    RigidFlowState,
    locate,
    predict,
    spread,
)
from poil_drake.perception.trackers.rigid_flow.coarse_views import (
    doubled,
    doubled_mask,
    is_coarse,
)
from poil_drake.perception.trackers.rigid_flow.config import RigidFlowConfig
from poil_drake.perception.trackers.rigid_flow.model_growth import (
    Keyframe,
    grow_model,
    needs_keyframe,
)
from poil_drake.perception.trackers.rigid_flow.object_model import build_model
from poil_drake.perception.trackers.rigid_flow.track_quality import LOST_AGREEMENT, part_confidence
from poil_drake.perception.trackers.rigid_flow.view_window import ViewWindow

_START = (1e-3, 1e-4)  # standard deviations of the first pose [rad, m], from the model's noise
_FOUND_NEAR = (float(np.radians(5.0)), 0.01)  # a smaller innovation needs no confirming [rad, m]
_CANDIDATE_AGREEMENT = 0.5  # from here on, a lost object's best pose is searched around next
_MAX_HIDDEN = 0.2  # longest time for which a hidden object is extrapolated without a prior [s]
_VELOCITY_GAIN = 0.7  # share of the newest velocity in the filtered one


class RigidFlowTracker:
    """Tracks points on one rigid object; a `Tracker`. The module's docstring describes the method.

    The reported positions move rigidly. A point that no view shows is still reported, but with less
    confidence.
    """

    def __init__(self, config: RigidFlowConfig | None = None):
        """Constructs the tracker.

        Args:
            config: Parameters; None for the defaults.
        """
        self.config = config or RigidFlowConfig()

    def start(
        self,
        frame: MultiViewFrame,
        query_points: np.ndarray,
        object_masks: tuple[np.ndarray, ...],
    ) -> TrackerOutput:
        """Starts tracking; see `Tracker.start`.

        Raises:
            InvalidValueError: if masks and images differ in number or size, or if query points are
                not finite.
            TrackingError: if the views show too little of the object.
        """
        masks = _checked_masks(frame, object_masks)
        points = frozen_array(query_points, name="query_points", shape=("N", 3))
        coarse = [is_coarse(camera, points.mean(axis=0)) for camera in frame.cameras]
        frame = doubled(frame, coarse)
        masks = tuple(
            doubled_mask(mask) if double else mask
            for mask, double in zip(masks, coarse, strict=True)
        )
        model, X_WO = build_model(frame, points, masks, self.config)
        state = RigidFlowState(
            model=model,
            keyframes=tuple(
                Keyframe.at(inverse(X_WO) @ camera.X_WC[:, 3], X_WO) for camera in frame.cameras
            ),
            pose=PoseEstimate(X_WO, spread(*_START), spread(*_START)),
            velocity=np.zeros(6),
            stamp=frame.stamp,
        )
        return TrackerOutput(state, TrackedPoints(points, np.ones(len(points)), frame.stamp), False)

    def step(
        self,
        state: RigidFlowState,
        frame: MultiViewFrame,
        motion_prior: np.ndarray | None = None,
    ) -> TrackerOutput:
        """Tracks the points to the next frame; see `Tracker.step`."""
        if motion_prior is not None:
            motion_prior = frozen_array(motion_prior, name="motion_prior", shape=(4, 4))
        views = zip(frame.cameras, state.model.appearance.reference_views, strict=True)
        frame = doubled(frame, [view.camera.width > camera.width for camera, view in views])
        elapsed = max(frame.stamp - state.stamp, 0.0)
        predicted = predict(state, elapsed, motion_prior, self.config)
        location = locate(state, frame, predicted, self.config)
        pose, evidence, windows = location
        expected = predicted.X_WO if motion_prior is None else motion_prior @ state.pose.X_WO
        motion = motion_between(expected, pose.X_WO)
        innovation = float(np.linalg.norm(motion[:3])), float(np.linalg.norm(motion[3:]))
        hidden_since = None
        if not evidence.is_supported:
            hidden_since = frame.stamp if state.hidden_since is None else state.hidden_since
        if state.lost_since is None:
            hidden = 0.0 if hidden_since is None else frame.stamp - hidden_since
            # A person's hand may turn at any time, so an extrapolation is soon wrong.
            gone = motion_prior is None and hidden > _MAX_HIDDEN
            tracked = not gone and evidence.supports_pose(LOST_AGREEMENT)
        else:
            near = innovation[0] <= _FOUND_NEAR[0] and innovation[1] <= _FOUND_NEAR[1]
            tracked = evidence.is_found and (near or state.unconfirmed)
        if not tracked:
            return _lost(state, frame, predicted, location)
        confidence = part_confidence(evidence, pose, state.model, windows)
        positions = transform_points(pose.X_WO, state.model.part_points)
        new_state = replace(
            state,
            pose=pose,
            velocity=_velocity(state, pose, elapsed),
            stamp=frame.stamp,
            innovation=innovation,
            hidden_since=hidden_since,
            lost_since=None,
            candidate=None,
            unconfirmed=False,
            steps=state.steps + 1,
        )
        # With a motion prior, a hand usually holds the object, and growth would add the hand.
        if motion_prior is None and evidence.may_learn:
            new_state = self._learn(new_state, windows)
        return TrackerOutput(new_state, TrackedPoints(positions, confidence, frame.stamp), False)

    def _learn(self, state: RigidFlowState, windows: Sequence[ViewWindow]) -> RigidFlowState:
        """Returns the state after the model has learnt from the views that need a keyframe."""
        X_WO = state.pose.X_WO
        keyframes = [Keyframe.at(window.at(X_WO).eye, X_WO) for window in windows]
        needed = [needs_keyframe(new, state.keyframes) for new in keyframes]
        if not any(needed):
            return state
        model = grow_model(state.model, list(compress(windows, needed)), X_WO, self.config)
        return replace(
            state, model=model, keyframes=(*state.keyframes, *compress(keyframes, needed))
        )


def _lost(
    state: RigidFlowState, frame: MultiViewFrame, predicted: PoseEstimate, best: Location
) -> TrackerOutput:
    """Returns the output for a frame in which the object is not found."""
    likely = best.evidence.agreement >= _CANDIDATE_AGREEMENT
    new_state = replace(
        state,
        pose=replace(predicted, covariance=state.pose.covariance),
        velocity=np.zeros(6),
        stamp=frame.stamp,
        lost_since=frame.stamp if state.lost_since is None else state.lost_since,
        candidate=best.pose.X_WO if likely else None,
        unconfirmed=state.lost_since is not None and best.evidence.is_found,
        steps=state.steps + 1,
    )
    points = TrackedPoints.lost(len(state.model.part_points), frame.stamp)
    return TrackerOutput(new_state, points, True)


def _velocity(state: RigidFlowState, pose: PoseEstimate, elapsed: float) -> np.ndarray:
    """Returns the filtered velocity (6,) of an object that has moved to `pose`."""
    if elapsed <= 0.0 or state.lost_since is not None:
        return np.zeros(6)
    newest = motion_between(state.pose.X_WO, pose.X_WO) / elapsed
    return _VELOCITY_GAIN * newest + (1.0 - _VELOCITY_GAIN) * state.velocity


def _checked_masks(frame: MultiViewFrame, masks: tuple[np.ndarray, ...]) -> tuple[np.ndarray, ...]:
    """Returns the masks as bool arrays; checks that each has the size of its view."""
    shapes = [image.depth.shape for image in frame.images]
    given = [np.shape(mask) for mask in masks]
    if given != shapes:
        raise InvalidValueError(
            f"object_masks have shapes {given}, but the frame's images have {shapes}.",
            remedy="Pass one mask (H, W) for each view, all False if it does not show the object.",
        )
    return tuple(np.asarray(mask, dtype=bool) for mask in masks)
