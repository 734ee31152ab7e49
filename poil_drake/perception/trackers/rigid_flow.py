"""The default tracker: aligns a model of the object, built from what is seen of it, frame by frame.

It needs no weights and no object model, runs on one core, and works on plain objects as on textured
ones. What it knows of the object is a cloud of oriented surface points and small patches of texture
(`object_model`). In every frame it aligns them with all views at once (`pose_alignment`), by depth,
by the object's outline and by texture, starting from a prediction: the motion of the hand that
holds the object, or constant velocity. All three compare with the first sight of a surface, never
with the previous frame, so errors do not add up from frame to frame.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from poil_drake.errors import InvalidValueError, TrackingError
from poil_drake.geometry.frozen_array import SharedOnCopy, frozen_array
from poil_drake.geometry.rigid_transform import inverse, transform_points
from poil_drake.perception.images import MultiViewFrame
from poil_drake.perception.tracked_points import TrackedPoints
from poil_drake.perception.trackers.model_growth import (
    Lesson,
    Witness,
    grow_model,
    make_witnesses,
    needs_lesson,
)
from poil_drake.perception.trackers.object_model import ObjectModel, build_model
from poil_drake.perception.trackers.pose_alignment import PoseEstimate, align, motion_between, move
from poil_drake.perception.trackers.pose_retry import retry
from poil_drake.perception.trackers.protocol import TrackerOutput
from poil_drake.perception.trackers.rigid_flow_config import RigidFlowConfig
from poil_drake.perception.trackers.track_quality import (
    Evidence,
    examine,
    is_borne_out,
    part_confidence,
)
from poil_drake.perception.trackers.view_window import ViewWindow, make_window


@dataclass(frozen=True, eq=False)
class RigidFlowState(SharedOnCopy):
    """What one step hands to the next.

    Attributes:
        model: The object.
        witnesses: What the first frame saw, for growth to compare with.
        lessons: From where the model has been learnt.
        pose: Where the object is, or where it was last believed to be.
        velocity: (6,) of the object in its own frame [rad/s, m/s].
        stamp: Time of capture of the last frame [s].
        lost: Whether the object is lost.
        evidence: What the last views said about the pose; None at the start.
    """

    model: ObjectModel
    witnesses: tuple[Witness, ...]
    lessons: tuple[Lesson, ...]
    pose: PoseEstimate
    velocity: np.ndarray
    stamp: float
    lost: bool
    evidence: Evidence | None


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
            witnesses=make_witnesses(frame, masks, X_WO),
            lessons=tuple(
                Lesson.at(inverse(X_WO) @ camera.X_WC[:, 3], X_WO) for camera in frame.cameras
            ),
            pose=PoseEstimate(X_WO, spread, spread),
            velocity=np.zeros(6),
            stamp=frame.stamp,
            lost=False,
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
        predicted = self._predict(state, elapsed, motion_prior)
        windows = self._windows(state.model, frame, predicted.X_WO)
        pose, evidence = self._locate(state, windows, predicted)
        needed = (
            self.config.quality.found_agreement
            if state.lost
            else self.config.quality.lost_agreement
        )
        lost = not is_borne_out(evidence, pose, state.model, needed, self.config.quality)
        if lost:
            pose = replace(predicted, doubt=state.pose.doubt)
            velocity = np.zeros(6)
            points = TrackedPoints.lost(len(state.model.part_points), frame.stamp)
        else:
            velocity = self._velocity(state, pose, elapsed)
            confidence = part_confidence(evidence, pose, state.model, windows, self.config.quality)
            positions = transform_points(pose.X_WO, state.model.part_points)
            points = TrackedPoints(positions, confidence, frame.stamp)
        new_state = replace(
            state, pose=pose, velocity=velocity, stamp=frame.stamp, lost=lost, evidence=evidence
        )
        if not lost:
            new_state = self._learn(new_state, windows, held=motion_prior is not None)
        return TrackerOutput(new_state, points, lost)

    def _predict(
        self, state: RigidFlowState, elapsed: float, motion_prior: np.ndarray | None
    ) -> PoseEstimate:
        """Returns where the object is expected, and how surely."""
        motion = self.config.motion
        if motion_prior is not None:
            X_WO = motion_prior @ state.pose.X_WO
            angular, linear = motion.prior_angular, motion.prior_linear
        else:
            ahead = motion.velocity_damping * min(elapsed, motion.max_extrapolation)
            X_WO = move(state.pose.X_WO, state.velocity * ahead)
            angular, linear = motion.free_angular, motion.free_linear
        spread = np.diag(np.repeat((np.array([angular, linear]) * elapsed) ** 2, 3))
        return PoseEstimate(X_WO, state.pose.covariance + spread, state.pose.doubt + spread)

    def _windows(
        self, model: ObjectModel, frame: MultiViewFrame, X_WO: np.ndarray
    ) -> list[ViewWindow]:
        """Returns the windows around the object of the views that it may be seen in."""
        points_W = transform_points(X_WO, model.points)
        windows = [
            make_window(index, camera, image, points_W, self.config.window)
            for index, (camera, image) in enumerate(zip(frame.cameras, frame.images, strict=True))
        ]
        return [window for window in windows if window is not None]

    def _locate(
        self, state: RigidFlowState, windows: Sequence[ViewWindow], predicted: PoseEstimate
    ) -> tuple[PoseEstimate, Evidence]:
        """Aligns from the prediction, and where that fails from poses around it."""
        pose = align(state.model, windows, predicted, self.config)
        evidence = examine(state.model, windows, pose.X_WO, self.config)
        quality = self.config.quality
        good = quality.found_agreement if state.lost else quality.retry_agreement
        if evidence.agreement >= good and evidence.support >= quality.min_support:
            return pose, evidence
        guesses = [predicted.X_WO, state.pose.X_WO]
        other = retry(state.model, windows, guesses, predicted.doubt, self.config)
        if other is not None and other[1].score > evidence.score:
            return other
        return pose, evidence

    def _velocity(self, state: RigidFlowState, pose: PoseEstimate, elapsed: float) -> np.ndarray:
        """Returns the velocity (6,) to carry on."""
        if elapsed <= 0.0 or state.lost:
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
        new = {
            window.index: Lesson.at(window.sight(pose.X_WO).eye, pose.X_WO) for window in windows
        }
        wanted = [w for w in windows if needs_lesson(new[w.index], state.lessons, growth)]
        sure = pose.point_deviations(state.model.part_points).max() < quality.learn_deviation
        if not wanted or not sure:
            return state
        model = grow_model(state.model, state.witnesses, wanted, pose.X_WO, self.config)
        lessons = state.lessons + tuple(new[w.index] for w in wanted)
        return replace(state, model=model, lessons=lessons)


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
