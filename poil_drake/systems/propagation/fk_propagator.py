"""Carries tracked points along with the hand that holds them, between the tracker's reports."""

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import Context, DiscreteValues, LeafSystem

from poil_drake.errors import InvalidValueError
from poil_drake.geometry.all_finite import all_finite
from poil_drake.geometry.rigid_transform import inverse, transform_points
from poil_drake.perception.tracked_points import TrackedPoints
from poil_drake.runtime.stopwatch import Stopwatch
from poil_drake.systems.ik.arm_kinematics import ArmKinematics
from poil_drake.systems.propagation.motion_history import (
    carried_along,
    empty_history,
    motion_at,
    record_motion,
)


class FkPropagator(LeafSystem):
    """Brings the points of the last track up to now with the arm's forward kinematics.

    .. pydrake_system::

        name: FkPropagator
        input_ports:
        - tracked_points
        - panda.position_measured
        - holding
        - image_time
        output_ports:
        - points
        - confidence
        - age
        - gripper_pose
        - object_motion

    The motion of the object since the start, X_M, follows the gripper frame while `holding`
    exceeds 0.5 and rests otherwise. Points that the tracker saw at t_c are at
    X_M(t) X_M(t_c)^-1 p(t_c) now, so that a late track costs nothing while the grasp is rigid.
    Every output is discrete state, sampled at the control period: nothing feeds through.

    - `points` (3N,) row-major [m, world]: NaN before the first track, and where that track did not
      see a point.
    - `confidence` (N,): zero before the first track and when `age` exceeds `max_age`.
    - `age` (1,) [s] since the capture that the points rest on: infinite before the first track.
    - `gripper_pose` (16,) X_WG row-major: NaN before the first finite joint positions, after that
      the last finite one.
    - `object_motion` (16,) X_M row-major at `image_time` (1,) [s], when the images were captured
      that a tracker is going to look at; now, while that port is not connected or NaN. The identity
      before anything is held; NaN where the images are older than what is remembered.

    A track is taken in when its stamp is newer than the last one's and at least one of its points
    was observed: through a short loss the last good track is carried on, until it is too old. While
    the joint positions are not finite, the motion rests and the age grows as ever. A `holding` that
    is NaN means no.
    """

    def __init__(
        self,
        *,
        num_points: int,
        kinematics: ArmKinematics,
        period: float,
        max_age: float = 0.5,
        history: float | None = None,
        stopwatch: Stopwatch | None = None,
    ):
        """Constructs the propagator.

        Args:
            num_points: How many points the tracker reports, N.
            kinematics: The arm and its gripper frame.
            period: The control period [s].
            max_age: How long points are trusted after their capture [s]; several periods of the
                tracker and its latency, yet short enough that a slip in the hand does little.
            history: How long motions are remembered [s], for tracks that come late; None: as long
                as points are trusted.
            stopwatch: Where to note how long updates take, under "control".
        """
        super().__init__()
        self._stopwatch = stopwatch or Stopwatch()
        self._num_points = num_points
        self._kinematics = kinematics
        self._period = period
        self._max_age = max_age
        self._scratch = kinematics.declare_scratch(self)

        self._tracked = self.DeclareAbstractInputPort(
            "tracked_points", Value(TrackedPoints.lost(num_points, -np.inf))
        )
        self._joints = self.DeclareVectorInputPort("panda.position_measured", kinematics.num_joints)
        self._holding = self.DeclareVectorInputPort("holding", 1)
        self._image_time = self.DeclareVectorInputPort("image_time", 1)

        outputs = {
            "points": np.full(3 * num_points, np.nan),
            "confidence": np.zeros(num_points),
            "age": np.array([np.inf]),
            "gripper_pose": np.full(16, np.nan),
            "object_motion": np.eye(4).ravel(),
        }
        self._state = {name: self.DeclareDiscreteState(value) for name, value in outputs.items()}
        for name in outputs:
            self.DeclareStateOutputPort(name, self._state[name])
        memory = {
            # X_M now.
            "motion": np.eye(4).ravel(),
            "stamp": np.array([-np.inf]),
            # Of the last track, undone by X_M at their capture.
            "track_positions": np.full(3 * num_points, np.nan),
            "history": empty_history(max_age if history is None else history, period).ravel(),
        }
        self._state |= {name: self.DeclareDiscreteState(value) for name, value in memory.items()}
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._update)

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        with self._stopwatch.measure("control"):
            self._advance(context, discrete_state)

    def _advance(self, context: Context, discrete_state: DiscreteValues) -> None:
        time = context.get_time()

        def state(name: str) -> np.ndarray:
            return discrete_state.get_mutable_value(self._state[name])

        X_M = state("motion").reshape(4, 4)
        moved = self._move(context, state("gripper_pose").reshape(4, 4), X_M)
        history = state("history").reshape(-1, 17)
        record_motion(history, time, X_M, self._period)
        state("object_motion")[:] = self._motion_of_images(context, time, X_M, history).ravel()

        tracked = self._eval_tracked(context)
        stamp = state("stamp")
        news = tracked.stamp > stamp[0] and bool((tracked.confidence > 0.0).any())
        if news:
            stamp[0] = tracked.stamp
            positions, confidence = self._take_in(tracked, time, history)
            state("track_positions")[:] = positions.ravel()
            state("confidence")[:] = confidence

        age = time - stamp[0]
        state("age")[0] = age
        if not age <= self._max_age:
            state("confidence")[:] = 0.0
        if news or moved:
            points = transform_points(X_M, state("track_positions").reshape(-1, 3))
            state("points")[:] = points.ravel()

    def _move(self, context: Context, X_WG: np.ndarray, X_M: np.ndarray) -> bool:
        """Updates the gripper's pose X_WG (4, 4), and the motion X_M (4, 4) of a held object.

        Returns whether the object was held.
        """
        joints = self._joints.Eval(context)
        if not all_finite(joints):
            return False
        X_WG_now = self._kinematics.pose(self._scratch.Eval(context), joints)
        held = self._holding.Eval(context)[0] > 0.5 and all_finite(X_WG)
        if held:
            X_M[:] = carried_along(X_M, X_WG, X_WG_now)
        X_WG[:] = X_WG_now
        return held

    def _motion_of_images(
        self, context: Context, time: float, X_M: np.ndarray, history: np.ndarray
    ) -> np.ndarray:
        """Returns X_M (4, 4) at the capture of the images that are there; NaN if not known."""
        if not self._image_time.HasValue(context):
            return X_M
        captured = self._image_time.Eval(context)[0]
        if np.isnan(captured) or captured >= time:
            return X_M
        known = motion_at(history, captured, self._period)
        return np.full((4, 4), np.nan) if known is None else known

    def _take_in(
        self, tracked: TrackedPoints, time: float, history: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Returns a track's positions (N, 3), undone by X_M at their capture, and confidences."""
        X_M = motion_at(history, min(tracked.stamp, time), self._period)
        if X_M is None:  # Captured before the history begins: there is no telling where it is now.
            tracked = TrackedPoints.lost(self._num_points, tracked.stamp)
            X_M = np.eye(4)
        return transform_points(inverse(X_M), tracked.positions), tracked.confidence

    def _eval_tracked(self, context: Context) -> TrackedPoints:
        tracked = self._tracked.Eval(context)
        if not isinstance(tracked, TrackedPoints) or len(tracked.positions) != self._num_points:
            raise InvalidValueError(
                f"Port tracked_points of FkPropagator holds a {type(tracked).__name__}, but "
                f"TrackedPoints of {self._num_points} points are needed.",
                remedy="Connect a tracker, and give both systems the same number of points.",
            )
        return tracked
