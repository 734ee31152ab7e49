"""Keeps the arm safe: limits the controller's joint velocities, and stops the arm on a fault."""

import math
from collections.abc import Callable, Sequence

import numpy as np
from pydrake.systems.framework import Context, DiscreteValues, InputPort, LeafSystem

from poil_drake.errors import InvalidValueError
from poil_drake.robots.panda import NUM_JOINTS
from poil_drake.robots.panda_kinematics import PandaModel
from poil_drake.robots.posture_guard import PostureGuard, PostureRule
from poil_drake.robots.velocity_limiter import GuardedStep, JointMotion, VelocityLimiter
from poil_drake.runtime.stopwatch import Stopwatch
from poil_drake.systems.control_period import CONTROL_PERIOD
from poil_drake.systems.safety.faults import POSTURE_FAULTS, SafetyConfig, SafetyFault
from poil_drake.systems.safety.watch import SafetyMemory, SafetyObservation, watch

_INPUTS = {
    "velocity": NUM_JOINTS,
    "velocity_time": 1,
    "position_measured": NUM_JOINTS,
    "velocity_measured": NUM_JOINTS,
    "torque_external": NUM_JOINTS,
    "status": 3,
    "stop": 1,
    "reset": 1,
    "position_commanded": NUM_JOINTS,
}
_COMING_TO_REST = 0.1
"""An arm comes to rest within this time after its last command has expired [s]."""

_REST = np.zeros(NUM_JOINTS)


class SafetySupervisor(LeafSystem):
    """Passes on joint velocities within safe limits, and stops the arm on a fault.

    .. pydrake_system::

        name: SafetySupervisor
        input_ports:
        - velocity
        - velocity_time
        - position_measured
        - velocity_measured
        - torque_external
        - status
        - stop
        - reset
        - position_commanded
        - <camera>.image_time
        output_ports:
        - velocity
        - velocity_time
        - fault
        - scale
        - updated_at
        - position

    The inputs `velocity_time`, `stop`, `reset`, `position_commanded` and those of the cameras are
    optional. `velocity` (7,) [rad/s] is the desired velocity, computed at `velocity_time` (1,) [s];
    `position_measured` (7,) [rad], `velocity_measured` (7,) [rad/s], `torque_external` (7,) [N m]
    and `status` (3,) come from the robot, as in `FrankaStatusReceiver`; `stop` and `reset` (1,) are
    the numbers of requests so far; `<camera>.image_time` (1,) [s] is the capture time of the
    camera's newest image, NaN before the first.

    Outputs, all discrete state that is updated every control period:

    - `velocity` (7,) [rad/s]: the command to the robot. It respects the limits of speed,
      acceleration and jerk. From the commanded as well as from the measured posture, the arm can
      brake within the joints' position limits and the rules of the posture guard. There is one
      exception: after the process was suspended, the command jumps to the measured velocity, or to
      zero if the robot's driver has stopped the arm meanwhile.
    - `velocity_time` (1,) [s]: when `velocity` was computed.
    - `fault` (1,): a `SafetyFault`. After a fault the arm brakes and rests. A reset ends the fault
      if the arm is at rest and no cause of a fault persists.
    - `scale` (1,): the share of the desired velocity that the arm heads for, usually 1; 0 while it
      brakes or rests because of a fault.
    - `updated_at` (1,) [s]: when the last update took place, by `clock`; NaN without a clock.
    - `position` (7,) [rad]: the commanded posture; NaN at first, see below.

    A status is fresh if its absolute age is at most `status_age_limit` and the measured position is
    finite. Until an update has found the robot at rest with a fresh status, `velocity` is zero,
    `velocity_time` minus infinity, `scale` 0 and `position` NaN. While the status is not fresh, the
    arm brakes to rest. A NaN in `velocity`, `torque_external` or `stop` is a fault.

    While the arm is at rest, each update sets the commanded posture to the measured one. While the
    arm moves, the commanded posture integrates the commanded velocities. If an update is late by
    `clock`, the last velocity counts for that much longer. If `position_commanded` (7,) [rad] is
    connected, each update starts from that posture instead. It is a fault if the `PostureGuard`
    refuses the desired velocity even at an eighth of its speed.
    """

    def __init__(
        self,
        *,
        model: PandaModel | None = None,
        period: float = CONTROL_PERIOD,
        cameras: Sequence[str] = (),
        config: SafetyConfig | None = None,
        clock: Callable[[], float] | None = None,
        command_expiry: float = 0.1,
        stopwatch: Stopwatch | None = None,
    ):
        """Constructs the supervisor.

        Args:
            model: The arm, with the pose of its base; None for a Panda at the world's origin.
            period: The control period [s].
            cameras: Names of the cameras whose images are monitored.
            config: The thresholds and limits.
            clock: Returns a monotonic time [s], from which the supervisor detects that the process
                was suspended; the context's time does not advance meanwhile. None disables this
                detection, as in simulation.
            command_expiry: How long the robot's driver follows a command [s], by `clock`.
            stopwatch: Records the durations of the updates as "control".

        Raises:
            InvalidValueError: if the config does not have 7 torque limits.
        """
        super().__init__()
        self._config = config = config or SafetyConfig()
        if len(config.external_torque) != NUM_JOINTS:
            raise InvalidValueError(
                f"SafetyConfig.external_torque has {len(config.external_torque)} values.",
                remedy=f"Set {NUM_JOINTS} values, one for each joint.",
            )
        model = model or PandaModel()
        self._period, self._stopwatch = period, stopwatch or Stopwatch()
        self._clock, self._command_expiry = clock, command_expiry
        self._limiter = VelocityLimiter(
            limits=model.joint_limits, period=period, config=config.limiter
        )
        self._guard = PostureGuard(model=model, config=config.posture)
        self._torque_limits = np.array(config.external_torque)
        self._inputs = {
            name: self.DeclareVectorInputPort(name, size) for name, size in _INPUTS.items()
        }
        self._image_times = [
            self.DeclareVectorInputPort(f"{camera}.image_time", 1) for camera in cameras
        ]
        outputs = {
            "velocity": _REST,
            "velocity_time": [-np.inf],
            "fault": [SafetyMemory().fault],
            "scale": [0.0],
            "updated_at": [np.nan],
            "position": np.full(NUM_JOINTS, np.nan),
        }
        inner = {
            "acceleration": _REST,
            "cleared": np.full(1 + 6 * NUM_JOINTS, np.nan),
            "memory": SafetyMemory(),
            "image_times": np.full(len(cameras), np.nan),
        }
        self._state = {
            name: self.DeclareDiscreteState(np.array(value, dtype=float))
            for name, value in (outputs | inner).items()
        }
        for name in outputs:
            self.DeclareStateOutputPort(name, self._state[name])
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._update)

    def commanded_motion(self, context: Context) -> JointMotion:
        """Returns the commanded motion in the system's `context`; the position is NaN at first."""
        parts = ("position", "velocity", "acceleration")
        return JointMotion(
            *(np.array(context.get_discrete_state(self._state[part]).value()) for part in parts)
        )

    def posture_problem(self, context: Context) -> str | None:
        """After a posture fault, returns a clause on the rule closest to being broken; else None.

        Args:
            context: The system's context.
        """
        fault = SafetyFault(int(context.get_discrete_state(self._state["fault"]).value()[0]))
        if fault not in POSTURE_FAULTS.values():
            return None
        return self._guard.tightest(self.commanded_motion(context).position)

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        with self._stopwatch.measure("control"):
            self._advance(context, discrete_state)

    def _advance(self, context: Context, discrete_state: DiscreteValues) -> None:
        state = {
            name: discrete_state.get_mutable_value(index) for name, index in self._state.items()
        }
        motion = JointMotion(state["position"], state["velocity"], state["acceleration"])
        stalled = self._time_since_update(state["updated_at"])
        if stalled > 0.0:
            motion = self._motion_after(stalled, motion, context)
        reported = self._inputs["position_commanded"]
        if reported.HasValue(context):
            motion = motion._replace(position=np.array(reported.Eval(context)))
        observation = self._observe(context, motion, stalled, state["image_times"])
        memory = watch(
            SafetyMemory(*state["memory"].tolist()), observation, self._config, self._period
        )
        measured = self._inputs["position_measured"].Eval(context)
        if observation.standing and memory.fresh:
            motion = JointMotion.at_rest(np.array(measured))
        scale = 0.0
        if not math.isnan(motion.position[0]):
            if memory.fault or not memory.fresh:
                motion = self._limiter.step(motion, _REST)
            else:
                # The arm has moved on since its status was measured.
                lag = observation.status_age * motion.velocity
                offset = measured + lag - motion.position
                cleared = state["cleared"]
                motion, scale, refusal = self._guarded_step(context, motion, offset, cleared)
                if scale == 0.0 and refusal is not None:
                    memory = memory._replace(fault=float(POSTURE_FAULTS[refusal]))
            state["velocity_time"][0] = context.get_time()
        state["position"][:], state["velocity"][:], state["acceleration"][:] = motion
        state["scale"][0] = scale
        state["fault"][0] = memory.fault
        state["memory"][:] = memory

    def _time_since_update(self, updated_at: np.ndarray) -> float:
        """Sets `updated_at` to the clock's time; returns its increase [s], 0 without a clock."""
        if self._clock is None:
            return 0.0
        before, updated_at[0] = float(updated_at[0]), self._clock()
        return 0.0 if math.isnan(before) else float(updated_at[0]) - before

    def _motion_after(self, stalled: float, motion: JointMotion, context: Context) -> JointMotion:
        """Returns the present motion of an arm that was last commanded `stalled` seconds ago.

        Up to `stall_limit`, the motion continues as commanded. Later, the measured velocity counts
        if the status is fresh and the arm may still be moving. Without a fresh status, the motion
        continues as commanded until the command expires. In all other cases the arm is at rest.
        """
        driven_on = motion.position + (stalled - self._period) * motion.velocity
        if stalled <= self._config.stall_limit:
            return motion._replace(position=driven_on)
        measured = self._inputs["position_measured"].Eval(context)
        rest = JointMotion.at_rest(
            np.array(measured if np.isfinite(measured).all() else motion.position)
        )
        age = self._inputs["status"].Eval(context)[1]
        fresh = abs(age) <= self._config.status_age_limit
        if fresh and stalled <= self._command_expiry + _COMING_TO_REST:
            speeds = self._inputs["velocity_measured"].Eval(context)
            if not np.isfinite(speeds).all() or np.abs(speeds).max() <= self._config.rest_speed:
                return rest
            # The arm follows the last command, or the driver is stopping it.
            lowest, highest = np.minimum(0.0, motion.velocity), np.maximum(0.0, motion.velocity)
            return rest._replace(velocity=np.clip(speeds, lowest, highest))
        if stalled <= self._command_expiry:
            return motion._replace(position=driven_on)
        return rest

    def _guarded_step(
        self, context: Context, motion: JointMotion, offset: np.ndarray, cleared: np.ndarray
    ) -> GuardedStep[PostureRule]:
        """Returns the limiter's step for an arm that is `offset` (7,) [rad] from its command.

        The posture guard is asked only if the arm may have moved by the clearance `cleared[0]`
        since the last check.

        Args:
            context: The system's context.
            motion: The commanded motion.
            offset: The arm's position minus the commanded position.
            cleared: (43,) least clearance [m] of the six postures that were checked last, then
                these postures (6, 7) [rad], flattened; updated in place.
        """
        present = np.repeat([motion.position, motion.position + offset], 3, axis=0)

        def refuse(postures: np.ndarray) -> PostureRule | None:
            both = np.concatenate([postures, postures + offset])
            turns = both - cleared[1:].reshape(both.shape)
            if self._guard.largest_displacement(turns) < cleared[0]:
                return None
            cleared[0], cleared[1:] = self._guard.clearances(both).min(), both.ravel()
            return None if cleared[0] >= 0.0 else self._guard.broken_rule(both, present)

        wanted = self._inputs["velocity"].Eval(context)
        return self._limiter.guarded_step(motion, wanted, refuse, offset=offset)

    def _observe(
        self, context: Context, motion: JointMotion, stalled: float, image_times: np.ndarray
    ) -> SafetyObservation:
        """Returns the observation; updates `image_times` [s], one per camera, in place."""
        inputs, now = self._inputs, context.get_time()
        mode, age, success_rate = inputs["status"].Eval(context).tolist()
        measured = inputs["position_measured"].Eval(context)
        torques = inputs["torque_external"].Eval(context)
        speeds = np.abs(inputs["velocity_measured"].Eval(context))
        resting = not motion.velocity.any() and not motion.acceleration.any()
        standing = resting and bool(speeds.max() <= self._config.rest_speed)
        for camera, port in enumerate(self._image_times):
            captured = _optional(port, context, math.nan)
            if math.isfinite(captured):
                image_times[camera] = captured
        ages = [now - time for time in image_times.tolist() if not math.isnan(time)]
        return SafetyObservation(
            mode=mode,
            status_age=age,
            success_rate=success_rate,
            position_known=np.isfinite(measured).all(),
            torque_ratio=float((np.abs(torques) / self._torque_limits).max()),
            tracking_error=0.0 if standing else float(np.abs(measured - motion.position).max()),
            standing=standing,
            command_finite=np.isfinite(inputs["velocity"].Eval(context)).all(),
            command_age=now - _optional(inputs["velocity_time"], context, now),
            image_age=max(ages, default=0.0),
            image_ahead=max(0.0, -min(ages, default=0.0)),
            stalled=stalled,
            stops=_optional(inputs["stop"], context, 0.0),
            resets=_optional(inputs["reset"], context, 0.0),
        )


def _optional(port: InputPort, context: Context, default: float) -> float:
    """Returns the number at a port of size 1, or the default if the port is not connected."""
    return float(port.Eval(context)[0]) if port.HasValue(context) else default
