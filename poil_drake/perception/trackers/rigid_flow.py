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
from poil_drake.perception.trackers.object_look import observe
from poil_drake.perception.trackers.object_model import ObjectModel, build_model
from poil_drake.perception.trackers.pose_alignment import PoseEstimate, align, motion_between, move
from poil_drake.perception.trackers.pose_search import Guess, search
from poil_drake.perception.trackers.protocol import TrackerOutput
from poil_drake.perception.trackers.rigid_flow_config import RigidFlowConfig
from poil_drake.perception.trackers.track_quality import (
    Evidence,
    examine,
    is_borne_out,
    is_found,
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
        surprise: (angular [rad], linear [m]) how far the last motion was from what was expected
            of it, by the motion prior if there was one.
        lost_since: Time of capture of the frame in which the object was lost [s]; None while it is
            tracked.
        guess: (4, 4) where a lost object may be, from the last search; None without an idea.
        found: Whether the last search found a lost object, and the next has to confirm it.
        evidence: What the last views said about the pose; None at the start.
    """

    model: ObjectModel
    witnesses: tuple[Witness, ...]
    lessons: tuple[Lesson, ...]
    pose: PoseEstimate
    velocity: np.ndarray
    stamp: float
    surprise: tuple[float, float]
    lost_since: float | None
    guess: np.ndarray | None
    found: bool
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
            surprise=(0.0, 0.0),
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
        predicted = self._predict(state, elapsed, motion_prior)
        pose, evidence, windows = self._locate(state, frame, predicted)
        expected = predicted.X_WO if motion_prior is None else motion_prior @ state.pose.X_WO
        surprise = _distance(expected, pose.X_WO)
        quality = self.config.quality
        if state.lost_since is None:
            tracked = is_borne_out(evidence, pose, state.model, quality.lost_agreement, quality)
            found = False
        else:
            found = is_found(evidence, pose, state.model, quality)
            near = (
                surprise[0] <= quality.found_near_angular
                and surprise[1] <= quality.found_near_linear
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
            surprise=surprise,
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

    def _predict(
        self, state: RigidFlowState, elapsed: float, motion_prior: np.ndarray | None
    ) -> PoseEstimate:
        """Returns where the object is expected, and how surely."""
        motion = self.config.motion
        angular, linear = motion.prior_angular * elapsed, motion.prior_linear * elapsed
        obeyed = self._is_obedient(state, elapsed)
        if motion_prior is not None and (obeyed or state.lost_since is not None):
            X_WO = motion_prior @ state.pose.X_WO
        else:
            ahead = motion.velocity_damping * min(elapsed, motion.max_extrapolation)
            X_WO = move(state.pose.X_WO, state.velocity * ahead)
            # A motion that was off once may be as far off again.
            angular = max(motion.free_angular * elapsed, state.surprise[0])
            linear = max(motion.free_linear * elapsed, state.surprise[1])
        spread = np.diag(np.repeat(np.array([angular, linear]) ** 2, 3))
        return PoseEstimate(X_WO, state.pose.covariance + spread, state.pose.doubt + spread)

    def _is_obedient(self, state: RigidFlowState, elapsed: float) -> bool:
        """Returns whether the last motion was about as expected."""
        motion = self.config.motion
        angular, linear = motion.prior_angular * elapsed, motion.prior_linear * elapsed
        return (
            state.surprise[0] <= motion.disobedience * angular
            and state.surprise[1] <= motion.disobedience * linear
        )

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
        self, state: RigidFlowState, frame: MultiViewFrame, predicted: PoseEstimate
    ) -> tuple[PoseEstimate, Evidence, list[ViewWindow]]:
        """Aligns from the prediction, and where that fails from poses found by search."""
        quality = self.config.quality
        best: tuple[PoseEstimate, Evidence, list[ViewWindow]] | None = None
        if state.lost_since is None:
            best = self._align(state, frame, predicted)
            borne_out = is_borne_out(
                best[1], best[0], state.model, quality.retry_agreement, quality
            )
            obedient = self._is_obedient(state, frame.stamp - state.stamp)
            doubtful = quality.max_vacant if obedient else quality.retry_vacant
            if borne_out and best[1].vacant <= doubtful:
                return best
        sizes = self.config.search
        spread = np.diag(np.repeat(np.array([sizes.aligned_angular, sizes.aligned_linear]) ** 2, 3))
        for X_WO in search(
            state.model,
            frame,
            self._guesses(state, frame.stamp, predicted),
            round(frame.stamp / 1e-3),
            self.config,
        ):
            start = PoseEstimate(X_WO, spread, predicted.doubt + spread)
            other = self._align(state, frame, start)
            if best is None or other[1].score > best[1].score:
                best = other
        assert best is not None, "a search finds at least one pose"
        return best

    def _align(
        self, state: RigidFlowState, frame: MultiViewFrame, start: PoseEstimate
    ) -> tuple[PoseEstimate, Evidence, list[ViewWindow]]:
        """Aligns the model from one pose; returns the result, its evidence and the windows."""
        model, config = state.model, self.config
        windows = self._windows(model, frame, start.X_WO)
        around = observe(model.look, frame, start.X_WO[None, :3, 3], model.radius, config.look)
        pose = align(model, windows, around, start, config)
        return pose, examine(model, windows, around, pose.X_WO, config), windows

    def _guesses(self, state: RigidFlowState, stamp: float, predicted: PoseEstimate) -> list[Guess]:
        """Returns where to search: around what was expected, what was last seen, and the guess."""
        sizes = self.config.search
        missed = 0.0 if state.lost_since is None else stamp - state.lost_since
        angular = min(sizes.near_angular + sizes.growth_angular * missed, sizes.far_angular)
        linear = min(sizes.near_linear + sizes.growth_linear * missed, sizes.far_linear)
        guesses = [Guess(predicted.X_WO, angular, linear)]
        if state.lost_since is None:
            guesses.append(Guess(state.pose.X_WO, angular, linear))
        if state.guess is not None:
            guesses.append(Guess(state.guess, sizes.near_angular, sizes.near_linear))
        return guesses

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
