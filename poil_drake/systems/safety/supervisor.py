"""What stands between the controller's joint velocities and the robot."""

import math
from collections.abc import Callable, Sequence

import numpy as np
from pydrake.systems.framework import Context, DiscreteValues, InputPort, LeafSystem

from poil_drake.errors import InvalidValueError
from poil_drake.geometry.all_finite import all_finite
from poil_drake.robots.joint_limits import JointLimits
from poil_drake.robots.panda_kinematics import PandaModel
from poil_drake.robots.posture_guard import PostureGuard, PostureRule
from poil_drake.robots.velocity_limiter import JointMotion, VelocityLimiter
from poil_drake.runtime.stopwatch import Stopwatch
from poil_drake.systems.panda.velocity_driver import NUM_JOINTS
from poil_drake.systems.safety.faults import POSTURE_FAULTS, SafetyConfig, SafetyFault
from poil_drake.systems.safety.watch import SafetyMemory, SafetyObservation, watch

_INPUTS = {
    "velocity": NUM_JOINTS,
    "velocity_time": 1,
    "panda.position_measured": NUM_JOINTS,
    "panda.velocity_measured": NUM_JOINTS,
    "panda.torque_external": NUM_JOINTS,
    "panda.status": 3,
    "stop": 1,
    "reset": 1,
    "replayed_position": NUM_JOINTS,
}
_COMING_TO_REST = 0.1
"""So long after its last command has expired an arm has come to rest [s]."""

_UNKNOWN = np.full(NUM_JOINTS, np.nan)
_REST = np.zeros(NUM_JOINTS)


class SafetySupervisor(LeafSystem):
    """Lets joint velocities through as far as they are safe, and stops the arm for good reason.

    .. pydrake_system::

        name: SafetySupervisor
        input_ports:
        - velocity
        - velocity_time
        - panda.position_measured
        - panda.velocity_measured
        - panda.torque_external
        - panda.status
        - stop
        - reset
        - replayed_position
        - <camera>.image_time
        output_ports:
        - velocity
        - velocity_time
        - fault
        - scale
        - updated_at
        - position

    Inputs, of which `velocity_time`, `stop`, `reset`, `replayed_position` and the cameras' may stay
    unconnected:
    `velocity` (7,) [rad/s] is wanted, and was computed at `velocity_time` (1,) [s]; the robot's are
    those of the station; `stop` and `reset` (1,) count requests, and any growth is one;
    `<camera>.image_time` (1,) [s] is when its newest image was captured, NaN before the first.

    Outputs, all discrete state that is updated every control period:

    - `velocity` (7,) [rad/s]: what goes to the robot, always within the limits of speed,
      acceleration and jerk, and such that the arm can brake from it within the joints' position
      limits and the rules of the posture guard, from where it is commanded to be and from where it
      is measured. Only after the process was held up it is at once what the arm is measured to do,
      or zero where the robot's driver has stopped it since.
    - `velocity_time` (1,) [s]: when it was computed.
    - `fault` (1,): a `SafetyFault`. After a fault the arm brakes, and rests until a reset finds it
      at rest and nothing wrong any more.
    - `scale` (1,): the part of the wanted velocity that the arm goes for, 1 as a rule; 0 while it
      brakes or rests because of a fault.
    - `updated_at` (1,) [s]: when the last update was by the clock; NaN where there is none.
    - `position` (7,) [rad]: the posture that is commanded; NaN before the start.

    Before the first update, and until the robot was measured standing still, with a fresh status,
    the velocity is zero, its time minus infinity, and the scale 0. While the status is not fresh,
    or holds a NaN, the arm brakes along what was commanded; whatever else is NaN is a fault.

    The posture that is commanded is state as well. Whenever the arm stands it is taken from the
    measured one; while it moves, velocities count for as long as they were commanded by the clock,
    late updates or not. A velocity that a rule refuses at every speed is a fault. In a replay, in
    which nothing that is commanded now leads anywhere, it is the `replayed_position` (7,) [rad] of
    the run at each update.
    """

    def __init__(
        self,
        *,
        model: PandaModel,
        limits: JointLimits,
        period: float,
        cameras: Sequence[str] = (),
        config: SafetyConfig | None = None,
        clock: Callable[[], float] | None = None,
        command_expiry: float = 0.1,
        stopwatch: Stopwatch | None = None,
    ):
        """Constructs the supervisor.

        Args:
            model: The arm's kinematics, with its base where it stands in the world.
            limits: What its joints may do.
            period: The control period [s].
            cameras: Names of the cameras whose images are watched.
            config: When the arm is stopped, and how fast it may be.
            clock: Tells how long the process was held up [s]: the context's time stands still then.
                It must not be set meanwhile. None where nobody waits, as in simulation.
            command_expiry: For how long the robot's driver follows a command [s], by that clock.
            stopwatch: Where to note how long updates take, under "control".

        Raises:
            InvalidValueError: if there are not 7 joints with 7 limits of torque.
        """
        super().__init__()
        self._config = config = config or SafetyConfig()
        if not limits.lower.size == len(config.external_torque) == NUM_JOINTS:
            raise InvalidValueError(
                f"There are limits of {limits.lower.size} joints, and "
                f"{len(config.external_torque)} numbers in SafetyConfig.external_torque.",
                remedy=f"Give {NUM_JOINTS} of each.",
            )
        self._period, self._stopwatch = period, stopwatch or Stopwatch()
        self._clock, self._command_expiry = clock, command_expiry
        self._limiter = VelocityLimiter(limits=limits, period=period, config=config.limiter)
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
            "position": _UNKNOWN,
        }
        inner = {
            "acceleration": _REST,
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
        """Returns what is commanded in its own `context`; NaN positions before the start."""
        parts = ("position", "velocity", "acceleration")
        return JointMotion(
            *(np.array(context.get_discrete_state(self._state[part]).value()) for part in parts)
        )

    def posture_problem(self, context: Context) -> str | None:
        """Says in its own `context` which rule the arm was about to break; None if it was not."""
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
        measured = self._inputs["panda.position_measured"].Eval(context)
        wanted = self._inputs["velocity"].Eval(context)
        stalled = self._stalled_for(state["updated_at"])
        if stalled > self._config.stall_limit:
            motion = self._motion_after(stalled, motion, measured, context)
        elif stalled > 0.0:
            motion = self._followed(stalled, motion)
        replayed = self._inputs["replayed_position"]
        if replayed.HasValue(context):
            motion = motion._replace(position=np.array(replayed.Eval(context)))
        seen = self._observe(context, motion, measured, wanted, state["image_times"], stalled)
        memory = watch(SafetyMemory(*state["memory"].tolist()), seen, self._config, self._period)
        if seen.standing and memory.believed:
            motion = JointMotion.at_rest(np.array(measured))
        scale = 0.0
        if not math.isnan(motion.position[0]):
            motion, scale, memory = self._move(motion, wanted, memory, measured, seen.status_age)
            state["velocity_time"][0] = context.get_time()
        state["position"][:], state["velocity"][:], state["acceleration"][:] = motion
        state["scale"][0] = scale
        state["fault"][0] = memory.fault
        state["memory"][:] = memory

    def _followed(self, stalled: float, motion: JointMotion) -> JointMotion:
        """Returns where the last velocity led to that was followed for so long [s]."""
        lead = (stalled - self._period) * motion.velocity
        return motion._replace(position=motion.position + lead)

    def _motion_after(
        self, stalled: float, motion: JointMotion, measured: np.ndarray, context: Context
    ) -> JointMotion:
        """Returns what an arm does that was left without commands for long [s].

        What is measured may be from before: a process that was halted finds old messages first, or
        had looked at the newest one when it was halted. It counts only if it says itself to be
        fresh, and is not older than an arm takes to come to rest.
        """
        age = self._inputs["panda.status"].Eval(context)[1]
        fresh = abs(age) <= self._config.status_age_limit
        if fresh and stalled <= self._command_expiry + _COMING_TO_REST:
            speeds = self._inputs["panda.velocity_measured"].Eval(context)
            return _measured_motion(motion, measured, speeds, self._config.rest_speed)
        if stalled <= self._command_expiry:
            return self._followed(stalled, motion)
        return JointMotion.at_rest(np.array(measured if all_finite(measured) else motion.position))

    def _stalled_for(self, updated_at: np.ndarray) -> float:
        """Returns how long ago the last update was by the clock [s], and notes this one."""
        if self._clock is None:
            return 0.0
        before, updated_at[0] = float(updated_at[0]), self._clock()
        return 0.0 if math.isnan(before) else float(updated_at[0]) - before

    def _move(
        self,
        motion: JointMotion,
        wanted: np.ndarray,
        memory: SafetyMemory,
        measured: np.ndarray,
        status_age: float,
    ) -> tuple[JointMotion, float, SafetyMemory]:
        """Returns the motion one period later, how much of what is wanted it is, and the memory."""
        if memory.fault or not memory.believed:
            return self._limiter.step(motion, _REST), 0.0, memory
        # Since it was measured, the arm went on.
        offset = measured + status_age * motion.velocity - motion.position
        both = np.repeat([motion.position, motion.position + offset], 3, axis=0)

        def refuse(postures: np.ndarray) -> PostureRule | None:
            return self._guard.broken_rule(np.concatenate([postures, postures + offset]), both)

        step = self._limiter.guarded_step(motion, wanted, refuse, offset=offset)
        if step.share == 0.0 and step.reason is not None:
            memory = memory._replace(fault=float(POSTURE_FAULTS[step.reason]))
        return step.motion, step.share, memory

    def _observe(
        self,
        context: Context,
        motion: JointMotion,
        measured: np.ndarray,
        wanted: np.ndarray,
        image_times: np.ndarray,
        stalled: float,
    ) -> SafetyObservation:
        """Returns what is seen now, and notes in `image_times` the cameras' newest images."""
        inputs, now = self._inputs, context.get_time()
        mode, age, success_rate = inputs["panda.status"].Eval(context).tolist()
        torques = inputs["panda.torque_external"].Eval(context)
        speeds = np.abs(inputs["panda.velocity_measured"].Eval(context))
        resting = not motion.velocity.any() and not motion.acceleration.any()
        standing = resting and bool(speeds.max() <= self._config.rest_speed)
        computed = _optional(inputs["velocity_time"], context, now)
        for camera, port in enumerate(self._image_times):
            captured = _optional(port, context, math.nan)
            if math.isfinite(captured):
                image_times[camera] = captured
        # A NaN does not count, as of cameras without an image.
        ages = [now - time for time in image_times.tolist() if time == time]
        return SafetyObservation(
            mode=mode,
            status_age=age,
            success_rate=success_rate,
            position_known=all_finite(measured),
            torque_ratio=float((np.abs(torques) / self._torque_limits).max()),
            tracking_error=0.0 if standing else float(np.abs(measured - motion.position).max()),
            standing=standing,
            command_finite=all_finite(wanted),
            command_age=now - computed,
            image_age=max(ages, default=0.0),
            image_ahead=max(0.0, -min(ages, default=0.0)),
            stalled=stalled,
            stops=_optional(inputs["stop"], context, 0.0),
            resets=_optional(inputs["reset"], context, 0.0),
        )


def _measured_motion(
    motion: JointMotion, measured: np.ndarray, speeds: np.ndarray, rest_speed: float
) -> JointMotion:
    """Returns what an arm is measured to do.

    It may follow the last command still, or the driver may have stopped it. What is not known is as
    it was commanded, at rest.
    """
    position = np.array(measured if all_finite(measured) else motion.position)
    if not all_finite(speeds) or np.abs(speeds).max() <= rest_speed:
        return JointMotion.at_rest(position)
    lowest, highest = np.minimum(0.0, motion.velocity), np.maximum(0.0, motion.velocity)
    return JointMotion.at_rest(position)._replace(velocity=np.clip(speeds, lowest, highest))


def _optional(port: InputPort, context: Context, otherwise: float) -> float:
    """Returns the number at a port of one, or another one where it is not connected."""
    return float(port.Eval(context)[0]) if port.HasValue(context) else otherwise
