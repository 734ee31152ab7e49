"""The default tracker: aligns a model of the object, built from what is seen of it, frame by frame.

It needs no weights and no object model, runs on one core, and works on plain objects as on textured
ones. What it knows of the object is a cloud of oriented surface points and small patches of texture
(`object_model`). In every frame it aligns them with all views at once (`pose_alignment`), by depth,
by the object's outline and by texture, starting from a prediction: the motion of the hand that
holds the object, or constant velocity. All three compare with the first sight of a surface, never
with the previous frame, so errors do not add up from frame to frame. Where the prediction leads
nowhere, many poses are searched (`pose_search`), in every frame until the object is found again.
A pose is only believed if what is around it does not speak against it (`object_look`).
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from poil_drake.errors import InvalidValueError, TrackingError
from poil_drake.geometry.frozen_array import frozen_array
from poil_drake.geometry.rigid_transform import inverse, transform_points
from poil_drake.perception.images import MultiViewFrame
from poil_drake.perception.tracked_points import TrackedPoints
from poil_drake.perception.trackers.protocol import TrackerOutput
from poil_drake.perception.trackers.rigid_flow.alignment.pose_alignment import (
    PoseEstimate,
    motion_between,
)
from poil_drake.perception.trackers.rigid_flow.alignment.pose_location import locate, predict
from poil_drake.perception.trackers.rigid_flow.config import RigidFlowConfig
from poil_drake.perception.trackers.rigid_flow.model_growth import (
    Keyframe,
    grow_model,
    make_reference_views,
    needs_keyframe,
)
from poil_drake.perception.trackers.rigid_flow.object_model import build_model
from poil_drake.perception.trackers.rigid_flow.state import RigidFlowState
from poil_drake.perception.trackers.rigid_flow.track_quality import (
    Evidence,
    is_borne_out,
    is_found,
    part_confidence,
)
from poil_drake.perception.trackers.rigid_flow.view_window import ViewWindow


class RigidFlowTracker:
    """Follows part points on one rigid object; see the module.

    Points keep their place on the object: the reported positions move rigidly. A point that no
    view shows is still reported, with less confidence.
    """

    def __init__(self, config: RigidFlowConfig | None = None):
        """Constructs the tracker.

        Args:
            config: Parameters, None for the defaults.
        """
        self.config = config or RigidFlowConfig()

    def start(
        self,
        frame: MultiViewFrame,
        query_points: np.ndarray,
        object_masks: tuple[np.ndarray, ...],
    ) -> TrackerOutput:
        """Begins to track; see `PointTracker.start`.

        Raises:
            InvalidValueError: if masks and images do not match, or query points are not finite.
            TrackingError: if too little of the object is seen to track it.
        """
        masks = _checked_masks(frame, object_masks)
        points = frozen_array(query_points, name="query_points", shape=("N", 3))
        model, X_WO = build_model(frame, points, masks, self.config)
        motion = self.config.motion
        spread = np.diag(np.repeat(np.array([motion.start_angular, motion.start_linear]) ** 2, 3))
        state = RigidFlowState(
            model=model,
            reference_views=make_reference_views(frame, masks, X_WO),
            keyframes=tuple(
                Keyframe.at(inverse(X_WO) @ camera.X_WC[:, 3], X_WO) for camera in frame.cameras
            ),
            pose=PoseEstimate(X_WO, spread, spread),
            velocity=np.zeros(6),
            stamp=frame.stamp,
            innovation=(0.0, 0.0),
            lost_since=None,
            guess=None,
            found=False,
            evidence=None,
        )
        return TrackerOutput(state, TrackedPoints(points, np.ones(len(points)), frame.stamp), False)

    def step(
        self,
        state: RigidFlowState,
        frame: MultiViewFrame,
        motion_prior: np.ndarray | None = None,
    ) -> TrackerOutput:
        """Tracks into the next frame; see `PointTracker.step`."""
        if motion_prior is not None:
            motion_prior = frozen_array(motion_prior, name="motion_prior", shape=(4, 4))
        elapsed = max(frame.stamp - state.stamp, 0.0)
        predicted = predict(state, elapsed, motion_prior, self.config)
        pose, evidence, windows = locate(state, frame, predicted, self.config)
        expected = predicted.X_WO if motion_prior is None else motion_prior @ state.pose.X_WO
        innovation = _distance(expected, pose.X_WO)
        quality = self.config.quality
        if state.lost_since is None:
            tracked = is_borne_out(evidence, pose, state.model, quality.lost_agreement, quality)
            found = False
        else:
            found = is_found(evidence, pose, state.model, quality)
            near = (
                innovation[0] <= quality.found_near_angular
                and innovation[1] <= quality.found_near_linear
            )
            tracked = found and (near or state.found)
        if not tracked:
            return self._lost(state, frame, predicted, pose, evidence, found=found)
        confidence = part_confidence(evidence, pose, state.model, windows, quality)
        positions = transform_points(pose.X_WO, state.model.part_points)
        new_state = replace(
            state,
            pose=pose,
            velocity=self._velocity(state, pose, elapsed),
            stamp=frame.stamp,
            innovation=innovation,
            lost_since=None,
            guess=None,
            found=False,
            evidence=evidence,
        )
        new_state = self._learn(new_state, windows, held=motion_prior is not None)
        return TrackerOutput(new_state, TrackedPoints(positions, confidence, frame.stamp), False)

    def _lost(
        self,
        state: RigidFlowState,
        frame: MultiViewFrame,
        predicted: PoseEstimate,
        best: PoseEstimate,
        evidence: Evidence,
        *,
        found: bool,
    ) -> TrackerOutput:
        """Returns what a frame comes to in which the object is not found."""
        likely = evidence.agreement >= self.config.quality.guess_agreement
        state = replace(
            state,
            pose=replace(predicted, doubt=state.pose.doubt),
            velocity=np.zeros(6),
            stamp=frame.stamp,
            lost_since=frame.stamp if state.lost_since is None else state.lost_since,
            guess=best.X_WO if likely else None,
            found=found,
            evidence=evidence,
        )
        points = TrackedPoints.lost(len(state.model.part_points), frame.stamp)
        return TrackerOutput(state, points, True)

    def _velocity(self, state: RigidFlowState, pose: PoseEstimate, elapsed: float) -> np.ndarray:
        """Returns the velocity (6,) to carry on."""
        if elapsed <= 0.0 or state.lost_since is not None:
            return np.zeros(6)
        gain = self.config.motion.velocity_gain
        newest = motion_between(state.pose.X_WO, pose.X_WO) / elapsed
        return gain * newest + (1.0 - gain) * state.velocity

    def _learn(
        self, state: RigidFlowState, windows: Sequence[ViewWindow], *, held: bool
    ) -> RigidFlowState:
        """Lets the model grow where there is something new to see and the pose is sure."""
        growth, quality = self.config.growth, self.config.quality
        evidence, pose = state.evidence, state.pose
        if not (growth.with_motion_prior if held else growth.enabled) or evidence is None:
            return state
        if evidence.agreement < quality.learn_agreement or evidence.support < quality.min_support:
            return state
        if evidence.vacant > quality.retry_vacant:
            return state
        new = {
            window.index: Keyframe.at(window.sight(pose.X_WO).eye, pose.X_WO) for window in windows
        }
        wanted = [w for w in windows if needs_keyframe(new[w.index], state.keyframes, growth)]
        sure = pose.point_deviations(state.model.part_points).max() < quality.learn_deviation
        if not wanted or not sure:
            return state
        model = grow_model(state.model, state.reference_views, wanted, pose.X_WO, self.config)
        keyframes = state.keyframes + tuple(new[w.index] for w in wanted)
        return replace(state, model=model, keyframes=keyframes)


def _distance(X: np.ndarray, Y: np.ndarray) -> tuple[float, float]:
    """Returns the angle [rad] and the length [m] of the motion between poses (4, 4)."""
    motion = motion_between(X, Y)
    return float(np.linalg.norm(motion[:3])), float(np.linalg.norm(motion[3:]))


def _checked_masks(frame: MultiViewFrame, masks: tuple[np.ndarray, ...]) -> tuple[np.ndarray, ...]:
    """Returns the masks as bool arrays, one for each view and of its size."""
    shapes = [image.depth.shape for image in frame.images]
    given = [np.shape(mask) for mask in masks]
    if given != shapes:
        raise InvalidValueError(
            f"object_masks have shapes {given}, but the frame's images have {shapes}.",
            remedy="Pass one mask (H, W) for each view, all False where the object is not seen.",
        )
    if not any(np.any(mask) for mask in masks):
        raise TrackingError(
            "The object is seen in no view: all masks are empty.",
            remedy="Start to track when the detector has found the object.",
        )
    return tuple(np.asarray(mask, dtype=bool) for mask in masks)
