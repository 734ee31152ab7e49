"""Writes the signals of the closed loop to a run log."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from pydrake.common.value import AbstractValue, Value
from pydrake.multibody.plant import ExternallyAppliedSpatialForce
from pydrake.systems.framework import Context, InputPort, LeafSystem

from poil_drake.control.reference.point_trajectory import PointTrajectory
from poil_drake.perception.images import MultiViewFrame
from poil_drake.perception.tracked_points import TrackedPoints
from poil_drake.recording.run_log.layout import (
    DETECTOR_TIMES_TOPIC,
    JOINT_COMMANDS_TOPIC,
    ROBOT_STATUS_TOPIC,
    STOPS_TOPIC,
    TRACKER_TIMES_TOPIC,
    TWIST_TOPIC,
)
from poil_drake.recording.run_log.writer import RunLogWriter
from poil_drake.systems.absent import ABSENT
from poil_drake.systems.logging.logged_values import ROBOT_MODES, applied_forces, meaning

_CAMERAS = "cameras"
"""The status topic of the cameras' image times; "/cameras/status" in the log."""

_ROBOT_TOPICS = ("hand",)
"""The status topics that are logged with the robot's signals."""

_JOINT_STATES = {
    "position": "panda.position_measured",
    "velocity": "panda.velocity_measured",
    "effort": "panda.torque_external",
}
_JOINT_COMMANDS = {"position": "panda.position_commanded", "velocity": "panda.velocity"}
"""Fields of a logged joint command -> the input ports of their values, as in `_JOINT_STATES`."""


class McapLogger(LeafSystem):
    """Logs points, twist, joints, phase, statuses and camera images through a `RunLogWriter`.

    .. pydrake_system::

        name: McapLogger
        input_ports:
        - tracked_points
        - frame
        - tracker.times
        - detector.frame
        - detector.times
        - points
        - confidence
        - target_points
        - gripper_pose
        - spatial_velocity
        - panda.position_measured
        - panda.velocity_measured
        - panda.torque_external
        - panda.velocity
        - panda.position_commanded
        - phase
        - fault
        - stop
        - clock
        - panda.status
        - applied_spatial_force
        - <topic>.<field>

    With N points and J joints, these inputs are logged every `robot_period`:

    - `tracked_points` (`TrackedPoints`), if their stamp is new;
    - `frame` and `detector.frame` (`MultiViewFrame`, or any other value before the first): images
      whose stamp is new;
    - `tracker.times` and `detector.times` (3,) [s], each with the port `tracker.status` or
      `detector.status`, if one of the values has changed;
    - the measured and commanded joint positions [rad] and velocities [rad/s] (J,), and the external
      torques [N m] (J,); commands only if `panda.velocity` is connected;
    - `panda.status` (3,): the robot's mode, the age of its status [s] and the share of commands
      that arrive in time; with `clock` (1,), the supervisor's output `updated_at` [s];
    - `phase` (1,), if it has changed, with the reason why it began, which depends on `fault` (1,);
    - `stop` (1,), the number of requests to stop, if it has changed;
    - the topic `hand` of `statuses`, and the topic `cameras` if one of its times has changed.

    These inputs are logged every `period`:

    - `points` and `target_points` (3N,) row-major [m, world], with `confidence` (N,);
    - `gripper_pose` (16,), X_WG row-major; `spatial_velocity` (6,), (ω [rad/s], v [m/s]);
    - all topics of `statuses` but `hand`, each with one (1,) port per field;
    - `applied_spatial_force`, the plant's external forces, while there are any and when they end.

    Every port is optional. Tracked points, times and frames are logged from the first one on, and a
    gripper pose only if it is finite. NaN in other signals is logged as NaN. Publish events write
    the samples, so a periodic sample shows the state before the updates at its time.

    The code that opened the log must close it after the run.
    """

    def __init__(
        self,
        *,
        log: RunLogWriter,
        num_points: int,
        joint_names: Sequence[str],
        phase_names: Sequence[str] = (),
        phase_reason: Callable[[int, int], str] | None = None,
        body_names: Sequence[str] = (),
        statuses: Mapping[str, Sequence[str]] | None = None,
        texts: Mapping[str, Mapping[int, str]] | None = None,
        reference: PointTrajectory | None = None,
        period: float = 1 / 32,
        robot_period: float | None = None,
        robot_offset: float = 0.0,
    ):
        """Constructs the logger.

        Args:
            log: The log to write to.
            num_points: Number of points, N.
            joint_names: The arm's joints.
            phase_names: The phases' names, by index.
            phase_reason: Returns why a phase begins, given the indices of the phase and the fault.
            body_names: The names of the plant's bodies, by body index.
            statuses: Topic -> names of its scalar fields. Each field gets a port "<topic>.<field>".
                The log's topic is "/<topic>/status".
            texts: "<topic>.<field>" -> number -> text. The log gets the text of the field's number
                as "<field>_text".
            reference: The controller's reference; all its samples are written once, at the start.
            period: Time between samples [s].
            robot_period: Time between samples of the robot's signals [s]; None: `period`. A replay
                needs these signals at the control period, and recomputes the rest from them.
            robot_offset: Time of the first sample of the robot's signals [s]. If this is one time
                step of the plant, a sample shows what the controller read at the start of a period.
        """
        super().__init__()
        self._log, self._reference = log, reference
        self._joint_names, self._phase_names = tuple(joint_names), tuple(phase_names)
        self._phase_reason, self._body_names = phase_reason, tuple(body_names)
        self._statuses = {topic: tuple(fields) for topic, fields in (statuses or {}).items()}
        self._texts = texts or {}
        # The latest values in the file. They affect only what is written to it.
        self._written: dict[str, object] = {}
        self._declare_ports(num_points)
        self.DeclareInitializationPublishEvent(self._publish_reference)
        self.DeclarePeriodicPublishEvent(robot_period or period, robot_offset, self._publish_robot)
        self.DeclarePeriodicPublishEvent(period, 0.0, self._publish_rest)
        self.DeclareForcedPublishEvent(self._publish_robot)
        self.DeclareForcedPublishEvent(self._publish_rest)

    def _declare_ports(self, num_points: int) -> None:
        abstract: dict[str, AbstractValue] = {
            "tracked_points": Value(TrackedPoints.lost(num_points, 0.0)),
            "frame": Value(ABSENT),
            "detector.frame": Value(ABSENT),
            "applied_spatial_force": AbstractValue.Make([ExternallyAppliedSpatialForce()]),
        }
        joint_ports = (*_JOINT_STATES.values(), *_JOINT_COMMANDS.values())
        sizes = {
            "points": 3 * num_points,
            "confidence": num_points,
            "target_points": 3 * num_points,
            "gripper_pose": 16,
            "spatial_velocity": 6,
            "tracker.times": 3,
            "detector.times": 3,
            "panda.status": 3,
            **dict.fromkeys(joint_ports, len(self._joint_names)),
            **dict.fromkeys(("phase", "fault", "stop", "clock"), 1),
        }
        for topic, fields in self._statuses.items():
            sizes |= {f"{topic}.{field}": 1 for field in fields}
        self._ports: dict[str, InputPort] = {
            name: self.DeclareAbstractInputPort(name, model) for name, model in abstract.items()
        }
        for name, size in sizes.items():
            self._ports[name] = self.DeclareVectorInputPort(name, size)

    def _value(self, context: Context, name: str) -> Any:
        """Returns the value of a port; None if it is not connected or does not exist."""
        port = self._ports.get(name)
        return port.Eval(context) if port is not None and port.HasValue(context) else None

    def _is_new(self, key: str, value: object) -> bool:
        """Returns whether `value` differs from that of the last call with the same `key`."""
        if self._written.get(key) == value:
            return False
        self._written[key] = value
        return True

    def _publish_reference(self, context: Context) -> None:
        if self._reference is not None:
            samples = self._reference.positions.reshape(-1, 3)
            self._log.write_points("reference", samples, time=context.get_time())

    def _publish_robot(self, context: Context) -> None:
        self._write_frame(context, "frame")
        self._write_frame(context, "detector.frame")
        self._write_track(context)
        self._write_times(context, "tracker", TRACKER_TIMES_TOPIC)
        self._write_times(context, "detector", DETECTOR_TIMES_TOPIC)
        self._write_image_times(context)
        self._write_robot(context)
        self._write_statuses(context, robot=True)
        self._write_phase(context)
        self._write_stops(context)

    def _publish_rest(self, context: Context) -> None:
        self._write_points(context)
        self._write_motion(context)
        self._write_statuses(context, robot=False)
        self._write_disturbances(context)

    def _write_frame(self, context: Context, port: str) -> None:
        """Writes the images, calibrations and labels of a frame that are not in the log yet."""
        frame, time, log = self._value(context, port), context.get_time(), self._log
        if not isinstance(frame, MultiViewFrame) or not self._is_new(port, frame.stamp):
            return
        if frame.label_ids and self._is_new("label ids", frame.label_ids):
            log.write_label_ids(frame.label_ids)
        for camera, image in zip(frame.cameras, frame.images, strict=True):
            name, stamp = camera.name, image.stamp
            if self._is_new(f"calibration of {name}", camera):
                log.write_calibration(camera, time=time)
            if self._is_new(f"image of {name}", stamp):
                log.write_image(name, image.rgb, time=time, stamp=stamp)
                log.write_depth(name, image.depth, time=time, stamp=stamp)
            if image.label is not None and self._is_new(f"label of {name}", stamp):
                log.write_label(name, image.label, time=time, stamp=stamp)

    def _write_track(self, context: Context) -> None:
        tracked: TrackedPoints | None = self._value(context, "tracked_points")
        if tracked is None or not np.isfinite(tracked.stamp):
            return
        if self._is_new("tracked", tracked.stamp):
            self._log.write_points(
                "tracked",
                tracked.positions,
                time=context.get_time(),
                stamp=tracked.stamp,
                confidence=tracked.confidence,
                exact=True,
            )

    def _write_changed(self, context: Context, topic: str, values: Mapping[str, float]) -> None:
        # As bytes, because NaN does not equal itself.
        if self._is_new(topic, np.array([*values.values()]).tobytes()):
            self._log.write_status(topic, values, time=context.get_time())

    def _write_times(self, context: Context, name: str, topic: str) -> None:
        times = self._value(context, f"{name}.times")
        if times is None or not np.isfinite(times).any():
            return
        values = dict(zip(("begun", "released", "released_of"), times.tolist(), strict=True))
        if (status := self._value(context, f"{name}.status")) is not None:
            values["status"] = float(status[0])
        self._write_changed(context, topic, values)

    def _write_image_times(self, context: Context) -> None:
        """Writes the cameras' image times if a new image has arrived."""
        fields = self._statuses.get(_CAMERAS, ())
        found = [self._value(context, f"{_CAMERAS}.{field}") for field in fields]
        times = np.array([value[0] for value in found if value is not None])
        # A camera without a delay always has an image of the current time.
        came = np.any(np.isfinite(times) & (times != context.get_time()))
        if came and self._is_new(_CAMERAS, times.tobytes()):
            self._write_status(context, _CAMERAS)

    def _write_robot(self, context: Context) -> None:
        time, log = context.get_time(), self._log
        states = {key: self._value(context, port) for key, port in _JOINT_STATES.items()}
        if any(value is not None for value in states.values()):
            log.write_joint_states(self._joint_names, time=time, **states)
        commands = {key: self._value(context, port) for key, port in _JOINT_COMMANDS.items()}
        if commands["velocity"] is not None:
            log.write_joint_states(
                self._joint_names, time=time, topic=JOINT_COMMANDS_TOPIC, **commands
            )
        status = self._value(context, "panda.status")
        if status is not None:
            mode, age, success_rate = status.tolist()
            values = {"mode": mode, "mode_text": meaning(ROBOT_MODES, mode)}
            values |= {"age": age, "success_rate": success_rate}
            if (clock := self._value(context, "clock")) is not None:
                values["clock"] = float(clock[0])
            log.write_status(ROBOT_STATUS_TOPIC, values, time=time)

    def _write_phase(self, context: Context) -> None:
        phase = self._value(context, "phase")
        if phase is None or not self._is_new("phase", float(phase[0])):
            return
        index, fault, reason = int(phase[0]), self._value(context, "fault"), ""
        if self._phase_reason is not None:
            reason = self._phase_reason(index, 0 if fault is None else int(fault[0]))
        name = meaning(dict(enumerate(self._phase_names)), index)
        self._log.write_phase(name, time=context.get_time(), reason=reason)

    def _write_stops(self, context: Context) -> None:
        if (stops := self._value(context, "stop")) is not None:
            self._write_changed(context, STOPS_TOPIC, {"requests": float(stops[0])})

    def _write_points(self, context: Context) -> None:
        time = context.get_time()
        points, confidence = self._value(context, "points"), self._value(context, "confidence")
        if points is not None:
            points = points.reshape(-1, 3)
            self._log.write_points("propagated", points, time=time, confidence=confidence)
        target = self._value(context, "target_points")
        if target is not None:
            self._log.write_points("target", target.reshape(-1, 3), time=time)

    def _write_motion(self, context: Context) -> None:
        time = context.get_time()
        X_WG = self._value(context, "gripper_pose")
        if X_WG is not None and np.all(np.isfinite(X_WG)):
            self._log.write_transform(X_WG.reshape(4, 4), child="gripper", time=time)
        twist = self._value(context, "spatial_velocity")
        if twist is not None:
            self._log.write_twist(TWIST_TOPIC, twist, time=time)

    def _write_statuses(self, context: Context, *, robot: bool) -> None:
        for topic in self._statuses:
            if (topic in _ROBOT_TOPICS) is robot:
                self._write_status(context, topic)

    def _write_status(self, context: Context, topic: str) -> None:
        values: dict[str, float | str] = {}
        for field in self._statuses[topic]:
            value = self._value(context, f"{topic}.{field}")
            if value is None:
                continue
            values[field] = float(value[0])
            if texts := self._texts.get(f"{topic}.{field}"):
                values[f"{field}_text"] = meaning(texts, value[0])
        if values:
            self._log.write_status(f"/{topic}/status", values, time=context.get_time())

    def _write_disturbances(self, context: Context) -> None:
        forces = self._value(context, "applied_spatial_force") or []
        applied = applied_forces(forces, self._body_names)
        # One empty record shows that a push is over.
        if applied or self._written.get("disturbed"):
            values = {"applied": applied}
            self._log.write_status("/disturbances/status", values, time=context.get_time())
        self._written["disturbed"] = bool(applied)
