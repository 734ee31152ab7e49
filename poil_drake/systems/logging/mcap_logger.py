"""Writes what happens in the closed loop to a run log."""

from collections.abc import Callable, Mapping, Sequence

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
from poil_drake.systems.logging.logged_frame import log_frame
from poil_drake.systems.logging.logged_values import ROBOT_MODES, applied_forces, meaning
from poil_drake.systems.logging.mcap_logger_config import McapLoggerConfig


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

    Inputs, N points and J joints: `tracked_points` (`TrackedPoints`) is written once for each
    stamp, `frame` and `detector.frame` (`MultiViewFrame`, anything else before the first) once for
    each image's; the `times` (3,) of tracker and detector (see there) whenever they change, or the
    `status` in the topics `tracker` and `detector`, with that; the topic `cameras` also whenever
    one of its times changes;
    `points` and `target_points`
    (3N,) row-major [m, world] with `confidence` (N,); `gripper_pose` (16,) X_WG row-major;
    `spatial_velocity` (6,), (ω [rad/s], v [m/s]); the measured joint positions [rad], velocities
    [rad/s] and torques [Nm] (J,); `panda.velocity`, the joint velocities commanded [rad/s], and the
    positions with them; `phase`
    (1,), written when it changes, with the reason, for which `fault` (1,) is looked at; `stop`
    (1,), how often a stop was requested, written when it changes; `clock` (1,), the time by the
    clock [s] when the supervisor was last updated, written with the robot's status;
    `panda.status` (3,), robot mode, age [s] and share of commands in time; `applied_spatial_force`,
    the forces on bodies as the plant takes them, written while there are any and when they end; and
    for each status topic one (1,) port per field.

    Any port may stay unconnected: what it carries is then not logged. The same holds for tracked
    points and frames before the first; NaN in the rest is logged as such. Everything is written by
    periodic (and forced) publish events, so a sample shows the state at the end of its step.

    The log belongs to whoever opened it: close it (or use it as a `with` block) after the run.
    `Close` is a convenience for that; nothing is closed by a destructor, which may never run.
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
        config: McapLoggerConfig | None = None,
    ):
        """Constructs the logger.

        Args:
            log: Where to write.
            num_points: Number of points, N.
            joint_names: The arm's joints.
            phase_names: The phases' names, by index.
            phase_reason: Says why a phase begins, from its index and the fault's.
            body_names: The names of the plant's bodies, by index.
            statuses: Topic -> names of its scalar fields. The ports are named
                "<topic>.<field>", the log's topics "/<topic>/status".
            texts: "<topic>.<field>" -> what its numbers mean, written beside them as
                "<field>_text".
            reference: What the controller follows; all its samples are written once, at the start.
            config: What is logged, and when.
        """
        super().__init__()
        self._log, self._reference = log, reference
        self._config = config or McapLoggerConfig()
        self._joint_names, self._phase_names = tuple(joint_names), tuple(phase_names)
        self._phase_reason, self._body_names = phase_reason, tuple(body_names)
        self._statuses = {topic: tuple(fields) for topic, fields in (statuses or {}).items()}
        self._texts = texts or {}
        # What the file holds already. Nothing but the file depends on it.
        self._written: dict[str, object] = {}
        self._declare_ports(num_points)
        self.DeclareInitializationPublishEvent(self._publish_reference)
        robot_period = self._config.robot_period or self._config.period
        self.DeclarePeriodicPublishEvent(
            robot_period, self._config.robot_offset, self._publish_robot
        )
        self.DeclarePeriodicPublishEvent(self._config.period, 0.0, self._publish_rest)
        self.DeclareForcedPublishEvent(self._publish_robot)
        self.DeclareForcedPublishEvent(self._publish_rest)

    def Close(self) -> None:
        """Closes the log. The system must not publish any more."""
        self._log.close()

    def _declare_ports(self, num_points: int) -> None:
        joints = len(self._joint_names)
        self.DeclareAbstractInputPort("tracked_points", Value(TrackedPoints.lost(num_points, 0.0)))
        for name in ("frame", "detector.frame"):
            self.DeclareAbstractInputPort(name, Value(ABSENT))
        self.DeclareAbstractInputPort(
            "applied_spatial_force", AbstractValue.Make([ExternallyAppliedSpatialForce()])
        )
        sizes = {
            "points": 3 * num_points,
            "confidence": num_points,
            "target_points": 3 * num_points,
            "gripper_pose": 16,
            "spatial_velocity": 6,
            "panda.position_measured": joints,
            "panda.velocity_measured": joints,
            "panda.torque_external": joints,
            "panda.velocity": joints,
            "panda.position_commanded": joints,
            "phase": 1,
            "fault": 1,
            "stop": 1,
            "tracker.times": 3,
            "detector.times": 3,
            "clock": 1,
            "panda.status": 3,
        }
        for topic, fields in self._statuses.items():
            sizes |= {f"{topic}.{field}": 1 for field in fields}
        self._vectors: dict[str, InputPort] = {
            name: self.DeclareVectorInputPort(name, size) for name, size in sizes.items()
        }

    def _value(self, context: Context, name: str) -> np.ndarray | None:
        port = self._vectors.get(name)
        return port.Eval(context) if port is not None and port.HasValue(context) else None

    def _is_new(self, key: str, value: object) -> bool:
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

    def _write_frame(self, context: Context, name: str) -> None:
        port = self.GetInputPort(name)
        frame = port.Eval(context) if port.HasValue(context) else None
        if isinstance(frame, MultiViewFrame) and self._is_new(name, frame.stamp):
            log_frame(
                self._log,
                frame,
                time=context.get_time(),
                is_new=self._is_new,
                color=self._config.color,
                depth=self._config.depth,
            )

    def _write_times(self, context: Context, name: str, topic: str) -> None:
        times = self._value(context, f"{name}.times")
        if times is None or not np.isfinite(times).any():
            return
        begun, released, released_of = times.tolist()
        values = {"begun": begun, "released": released, "released_of": released_of}
        if (status := self._value(context, f"{name}.status")) is not None:
            values["status"] = float(status[0])
        if self._is_new(topic, np.array([*values.values()]).tobytes()):
            self._log.write_status(topic, values, time=context.get_time())

    def _write_image_times(self, context: Context) -> None:
        """Writes the cameras' statuses in between, when an image has come."""
        now = context.get_time()
        fields = self._statuses.get(_CAMERAS, ())
        found = [self._value(context, f"{_CAMERAS}.{field}") for field in fields]
        times = np.array([value[0] for value in found if value is not None])
        # Images of the moment, as of cameras that do not delay, come all the time.
        came = np.any(np.isfinite(times) & (times != now))
        if came and self._is_new(_CAMERAS, times.tobytes()):
            self._write_status(context, _CAMERAS)

    def _write_stops(self, context: Context) -> None:
        stops = self._value(context, "stop")
        if stops is not None and self._is_new("stop", float(stops[0])):
            values = {"requests": float(stops[0])}
            self._log.write_status(STOPS_TOPIC, values, time=context.get_time())

    def _write_track(self, context: Context) -> None:
        port = self.GetInputPort("tracked_points")
        if not port.HasValue(context):
            return
        tracked: TrackedPoints = port.Eval(context)
        if np.isfinite(tracked.stamp) and self._is_new("tracked", tracked.stamp):
            self._log.write_points(
                "tracked",
                tracked.positions,
                time=context.get_time(),
                stamp=tracked.stamp,
                confidence=tracked.confidence,
                exact=True,
            )

    def _write_points(self, context: Context) -> None:
        time = context.get_time()
        points = self._value(context, "points")
        if points is not None:
            self._log.write_points(
                "propagated",
                points.reshape(-1, 3),
                time=time,
                confidence=self._value(context, "confidence"),
            )
        target = self._value(context, "target_points")
        if target is not None:
            self._log.write_points("target", target.reshape(-1, 3), time=time)

    def _write_robot(self, context: Context) -> None:
        time = context.get_time()
        position = self._value(context, "panda.position_measured")
        velocity = self._value(context, "panda.velocity_measured")
        effort = self._value(context, "panda.torque_external")
        if any(value is not None for value in (position, velocity, effort)):
            self._log.write_joint_states(
                self._joint_names, time=time, position=position, velocity=velocity, effort=effort
            )
        commanded = self._value(context, "panda.velocity")
        if commanded is not None:
            self._log.write_joint_states(
                self._joint_names,
                time=time,
                position=self._value(context, "panda.position_commanded"),
                velocity=commanded,
                topic=JOINT_COMMANDS_TOPIC,
            )
        status = self._value(context, "panda.status")
        if status is not None:
            mode, age, success_rate = status.tolist()
            values = {"mode": mode, "mode_text": meaning(ROBOT_MODES, mode)}
            values |= {"age": age, "success_rate": success_rate}
            clock = self._value(context, "clock")
            values |= {} if clock is None else {"clock": float(clock[0])}
            self._log.write_status(ROBOT_STATUS_TOPIC, values, time=time)

    def _write_motion(self, context: Context) -> None:
        time = context.get_time()
        X_WG = self._value(context, "gripper_pose")
        if X_WG is not None and np.all(np.isfinite(X_WG)):
            self._log.write_transform(
                X_WG.reshape(4, 4), child=self._config.gripper_frame, time=time
            )
        twist = self._value(context, "spatial_velocity")
        if twist is not None:
            self._log.write_twist(TWIST_TOPIC, twist, time=time)

    def _write_phase(self, context: Context) -> None:
        phase, fault = self._value(context, "phase"), self._value(context, "fault")
        if phase is None or not self._is_new("phase", float(phase[0])):
            return
        index = int(phase[0])
        name = meaning(dict(enumerate(self._phase_names)), index)
        reason = ""
        if self._phase_reason is not None:
            reason = self._phase_reason(index, 0 if fault is None else int(fault[0]))
        self._log.write_phase(name, time=context.get_time(), reason=reason)

    def _write_statuses(self, context: Context, *, robot: bool) -> None:
        for topic in self._statuses:
            if (topic in self._config.robot_topics) is robot:
                self._write_status(context, topic)

    def _write_status(self, context: Context, topic: str) -> None:
        given: dict[str, float | str] = {}
        for field in self._statuses[topic]:
            value = self._value(context, f"{topic}.{field}")
            if value is None:
                continue
            given[field] = float(value[0])
            if texts := self._texts.get(f"{topic}.{field}"):
                given[f"{field}_text"] = meaning(texts, value[0])
        if given:
            self._log.write_status(f"/{topic}/status", given, time=context.get_time())

    def _write_disturbances(self, context: Context) -> None:
        port = self.GetInputPort("applied_spatial_force")
        forces = port.Eval(context) if port.HasValue(context) else []
        applied = applied_forces(forces, self._body_names)
        # One empty record tells that a push is over.
        if applied or self._written.get("disturbed"):
            values = {"applied": applied}
            self._log.write_status("/disturbances/status", values, time=context.get_time())
        self._written["disturbed"] = bool(applied)


_CAMERAS = "cameras"
"""The status topic of when images came; "/cameras/status" in the log."""
