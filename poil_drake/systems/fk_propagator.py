"""Propagates tracked points with the hand that holds the object, between the tracker's reports."""

import math

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import Context, DiscreteValues, LeafSystem

from poil_drake.errors import InvalidValueError
from poil_drake.geometry.rigid_transform import (
    inverse,
    make_transform,
    rotation_exp,
    rotation_log,
    transform_points,
)
from poil_drake.perception.tracked_points import TrackedPoints
from poil_drake.runtime.stopwatch import Stopwatch
from poil_drake.systems.control_period import CONTROL_PERIOD
from poil_drake.systems.ik.arm_kinematics import ArmKinematics, MakePandaKinematics

_ROW_SIZE = 17
"""Size of a row of a history: the time of the sample [s], then X (4, 4) row-major."""

_ON_GRID = 1e-6
"""A time within this fraction of a period from a sample counts as the sample's time."""


class FkPropagator(LeafSystem):
    """Propagates the points of the last track to the present with the arm's forward kinematics.

    .. pydrake_system::

        name: FkPropagator
        input_ports:
        - tracked_points
        - position_measured
        - holding
        - image_time
        output_ports:
        - points
        - confidence
        - age
        - gripper_pose
        - object_motion

    X_M is the object's motion since the start. It follows the gripper frame while `holding`
    exceeds 0.5, and is constant otherwise. A point p that the tracker observed at t_c is now at
    X_M(t) X_M(t_c)^-1 p(t_c), so that latency costs no accuracy while the grasp is rigid. Every
    output is discrete state, updated at the control period; there is no direct feedthrough.

    - `points` (3N,) row-major [m, world]: NaN before the first track, and for points that the last
      track did not observe.
    - `confidence` (N,) of the points in the last track; zero before the first track and when `age`
      exceeds `max_age`.
    - `age` (1,) [s]: time since the capture of the last track; infinite before the first track.
    - `gripper_pose` (16,) X_WG row-major: at the last finite joint positions; NaN before the first.
    - `object_motion` (16,) X_M row-major at `image_time` (1,) [s], the capture time of the images
      that the tracker processes next; the present X_M while `image_time` is not connected or NaN.
      It is the identity before the first grasp, and NaN if the images are older than `history`.

    `position_measured` (n,) [rad] holds the arm's joint positions. The system accepts a track if
    its stamp is newer than that of the last accepted track and at least one point was observed.
    While the object is lost, the system propagates the last accepted track, whose confidence
    becomes zero after `max_age`. While the joint positions are not finite, X_M does not change and
    `age` grows. A NaN in `holding` means not holding.
    """

    def __init__(
        self,
        *,
        num_points: int,
        kinematics: ArmKinematics | None = None,
        period: float = CONTROL_PERIOD,
        max_age: float = 0.5,
        history: float | None = None,
        stopwatch: Stopwatch | None = None,
    ):
        """Constructs the propagator.

        Args:
            num_points: The number of tracked points, N.
            kinematics: The arm and its gripper frame; None for a Panda at the world's origin.
            period: The control period [s].
            max_age: Age beyond which points have no confidence [s].
            history: How far back X_M is stored [s]; None for `max_age`. Points of a track that was
                captured earlier become NaN.
            stopwatch: Records the durations of the updates as "control".
        """
        super().__init__()
        self._stopwatch = stopwatch or Stopwatch()
        self._num_points = num_points
        self._kinematics = kinematics or MakePandaKinematics()
        self._period = period
        self._max_age = max_age
        self._history = max_age if history is None else history
        self._scratch = self._kinematics.declare_scratch(self)

        self._tracked = self.DeclareAbstractInputPort(
            "tracked_points", Value(TrackedPoints.lost(num_points, -np.inf))
        )
        self._joints = self.DeclareVectorInputPort("position_measured", self._kinematics.num_joints)
        self._holding = self.DeclareVectorInputPort("holding", 1)
        self._image_time = self.DeclareVectorInputPort("image_time", 1)

        outputs = {
            "points": np.full(3 * num_points, np.nan),
            "confidence": np.zeros(num_points),
            "age": np.array([np.inf]),
            "gripper_pose": np.full(16, np.nan),
            "object_motion": np.eye(4).ravel(),
        }
        memory = {
            # The present X_M, and the capture time of the images of "object_motion".
            "motion": np.eye(4).ravel(),
            "captured": np.array([np.nan]),
            "stamp": np.array([-np.inf]),
            # Positions of the last track, transformed by X_M^-1 at its capture.
            "track_positions": np.full(3 * num_points, np.nan),
            "history": empty_history(self._history, period).ravel(),
        }
        self._state = {
            name: self.DeclareDiscreteState(value) for name, value in (outputs | memory).items()
        }
        for name in outputs:
            self.DeclareStateOutputPort(name, self._state[name])
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
        history = state("history").reshape(-1, _ROW_SIZE)
        record_motion(history, time, X_M, self._period)
        captured = self._image_time.Eval(context)[0] if self._image_time.HasValue(context) else time
        if captured >= time or math.isnan(captured):
            state("object_motion")[:] = X_M.ravel()
        elif captured != state("captured")[0] or time - captured > self._history:
            known = motion_at(history, captured, self._period)
            state("object_motion")[:] = np.nan if known is None else known.ravel()
        state("captured")[0] = captured if captured < time else np.nan

        tracked = self._eval_tracked(context)
        stamp = state("stamp")
        accepted = tracked.stamp > stamp[0] and bool((tracked.confidence > 0.0).any())
        if accepted:
            stamp[0] = tracked.stamp
            X_M_captured = motion_at(history, min(tracked.stamp, time), self._period)
            if X_M_captured is None:  # The track is older than the history.
                tracked = TrackedPoints.lost(self._num_points, tracked.stamp)
                X_M_captured = np.eye(4)
            positions = transform_points(inverse(X_M_captured), tracked.positions)
            state("track_positions")[:] = positions.ravel()
            state("confidence")[:] = tracked.confidence

        age = time - stamp[0]
        state("age")[0] = age
        if not age <= self._max_age:
            state("confidence")[:] = 0.0
        if accepted or moved:
            points = transform_points(X_M, state("track_positions").reshape(-1, 3))
            state("points")[:] = points.ravel()

    def _move(self, context: Context, X_WG: np.ndarray, X_M: np.ndarray) -> bool:
        """Updates X_WG (4, 4) and, while the gripper holds the object, X_M (4, 4), both in place.

        Returns whether the gripper holds the object.
        """
        joints = self._joints.Eval(context)
        if not np.isfinite(joints).all():
            return False
        X_WG_now = self._kinematics.pose(self._scratch.Eval(context), joints)
        held = self._holding.Eval(context)[0] > 0.5 and np.isfinite(X_WG).all()
        if held:
            X_M[:] = X_WG_now @ inverse(X_WG) @ X_M
        X_WG[:] = X_WG_now
        return held

    def _eval_tracked(self, context: Context) -> TrackedPoints:
        tracked = self._tracked.Eval(context)
        size = len(tracked.positions) if isinstance(tracked, TrackedPoints) else None
        if size != self._num_points:
            found = f"a {type(tracked).__name__}" if size is None else f"{size} tracked points"
            raise InvalidValueError(
                f"Port tracked_points of FkPropagator has {found}, not {self._num_points} points.",
                remedy="Connect a tracker with as many points as the propagator.",
            )
        return tracked


def empty_history(duration: float, period: float) -> np.ndarray:
    """Returns an empty history (M, 17) for `duration` [s], with a row for every `period` [s]."""
    return np.full((math.ceil(duration / period) + 2, _ROW_SIZE), np.nan)


def record_motion(history: np.ndarray, time: float, X: np.ndarray, period: float) -> None:
    """Replaces the oldest row by X (4, 4) at `time` [s], a multiple of `period` [s]; in place."""
    row = history[round(time / period) % len(history)]
    row[0] = time
    row[1:] = X.ravel()


def motion_at(history: np.ndarray, time: float, period: float) -> np.ndarray | None:
    """Returns X (4, 4) at `time` [s], or None if the history does not cover that time.

    Between two samples the translation is interpolated linearly, the rotation along the geodesic.
    """
    before = math.floor(time / period + _ON_GRID)
    fraction = time / period - before
    first = _sample(history, before, period)
    if first is None or abs(fraction) <= _ON_GRID:
        return first
    second = _sample(history, before + 1, period)
    if second is None:
        return None
    turn = rotation_log(first[:3, :3].T @ second[:3, :3])
    return make_transform(
        first[:3, :3] @ rotation_exp(fraction * turn),
        (1.0 - fraction) * first[:3, 3] + fraction * second[:3, 3],
    )


def _sample(history: np.ndarray, tick: int, period: float) -> np.ndarray | None:
    row = history[tick % len(history)]
    held = abs(row[0] - tick * period) < 0.5 * period  # False for NaN
    return row[1:].reshape(4, 4).copy() if held else None
