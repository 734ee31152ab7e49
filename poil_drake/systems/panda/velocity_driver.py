"""The simulated Panda's velocity interface, which treats commands as the real driver does."""

import math
from dataclasses import dataclass

import numpy as np
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiscreteValues,
    InputPort,
    LeafSystem,
)

from poil_drake.errors import InvalidValueError
from poil_drake.robots.joint_limits import JointLimits
from poil_drake.robots.panda import NUM_JOINTS
from poil_drake.robots.panda_kinematics import PandaModel
from poil_drake.systems.statuses import RobotMode


@dataclass(frozen=True, kw_only=True)
class PandaDriver:
    """How the simulated robot follows velocity commands.

    Attributes:
        expire_sec: A command older than this [s] means zero velocity, as in the real driver.
        low_pass_hz: Cut-off of the first-order filter on commands [Hz], as in the real driver.
        leash: Largest difference between a joint's commanded and measured position [rad]: a blocked
            arm pushes no harder than stiffness * leash, and does not run away when it comes free.
        limit_margin: Distance that the joints keep from their position limits [rad].
        stiffness: Joint stiffness [N m / rad]; libfranka's default joint impedance.
        damping: Joint damping [N m s / rad]; about critical for the arm's own inertia.
        hand_stiffness: Stiffness of the fingers' drive [N / m], so high that the force limit
            determines the force of the grip.
        hand_damping: Damping of the fingers' drive [N s / m].
        hand_speed: Rate of change of the hand's opening [m / s].
    """

    expire_sec: float = 0.1
    low_pass_hz: float = 30.0
    leash: float = 0.05
    limit_margin: float = 0.01
    stiffness: tuple[float, ...] = (3000.0, 3000.0, 3000.0, 2500.0, 2500.0, 2000.0, 2000.0)
    damping: tuple[float, ...] = (120.0, 120.0, 100.0, 80.0, 50.0, 40.0, 30.0)
    hand_stiffness: float = 2e5
    hand_damping: float = 200.0
    hand_speed: float = 0.1

    def __post_init__(self) -> None:
        for name in ("stiffness", "damping"):
            if len(getattr(self, name)) != NUM_JOINTS:
                raise InvalidValueError(
                    f"PandaDriver.{name} has {len(getattr(self, name))} values.",
                    remedy=f"Set {NUM_JOINTS} values, one for each joint of the arm.",
                )
        for name, value in vars(self).items():
            may_be_zero = name in ("limit_margin", "damping", "hand_damping")
            numbers = np.ravel(value)
            positive = numbers >= 0.0 if may_be_zero else numbers > 0.0
            if not (np.isfinite(numbers) & positive).all():
                raise InvalidValueError(
                    f"PandaDriver.{name} is {value}.",
                    remedy="It must be finite and "
                    + ("not negative." if may_be_zero else "positive."),
                )


def step_joints(
    *,
    position: np.ndarray,
    velocity: np.ndarray,
    wanted: np.ndarray,
    measured: np.ndarray,
    limits: JointLimits,
    config: PandaDriver,
    time_step: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Advances the joints' commanded positions by one step.

    A low-pass filter smooths the desired velocity. Then, as in libfranka's rate limiter, each joint
    respects its largest speed and acceleration, and can brake before its position limits. Finally,
    the commanded position is clipped to at most `config.leash` from the measured position.

    Args:
        position: (7,) commanded positions [rad].
        velocity: (7,) commanded velocities [rad/s].
        wanted: (7,) velocities to follow [rad/s], finite.
        measured: (7,) measured positions [rad]; a NaN disables the leash.
        limits: Limits of the joints.
        config: Filter, leash and margin.
        time_step: Duration of the step [s].

    Returns:
        The commanded positions and velocities (7,) after the step.
    """
    lower, upper = limits.lower + config.limit_margin, limits.upper - config.limit_margin
    change = limits.acceleration * time_step

    def speed_limit(room: np.ndarray) -> np.ndarray:
        # v dt + v^2 / (2 a) = room: the step at this speed, and the braking after it.
        braking = change * change + 2 * limits.acceleration * np.maximum(room, 0.0)
        return np.fmin(limits.velocity, np.sqrt(braking) - change)

    rate = 2 * math.pi * config.low_pass_hz * time_step
    filtered = velocity + rate / (1 + rate) * (wanted - velocity)
    limited = np.clip(filtered, -speed_limit(position - lower), speed_limit(upper - position))
    limited = np.clip(limited, velocity - change, velocity + change)
    next_position = position + time_step * limited
    reached = np.clip(
        next_position,
        np.fmax(lower, measured - config.leash),
        np.fmin(upper, measured + config.leash),
    )
    # A joint that is held by its limits or its leash gets zero velocity, which prevents windup.
    return reached, np.where(reached == next_position, limited, 0.0)


def eval_velocity(
    context: Context, velocity: InputPort, velocity_time: InputPort, *, max_age: float
) -> np.ndarray | None:
    """Returns the velocity at the port `velocity` if there is a valid one, else None.

    A velocity is valid if it is finite and not more than `max_age` [s] old. Its age is the
    context's time minus the value [s] of `velocity_time`; if that value is NaN, the velocity is
    invalid. If `velocity_time` is not connected, the age does not matter.
    """
    if not velocity.HasValue(context):
        return None
    if velocity_time.HasValue(context):
        age = context.get_time() - velocity_time.Eval(context)[0]
        if not age <= max_age:
            return None
    value = velocity.Eval(context)
    return value if np.isfinite(value).all() else None


class PandaVelocityDriver(LeafSystem):
    """Converts velocity commands to the desired state of the simulated arm's joint controllers.

    .. pydrake_system::

        name: PandaVelocityDriver
        input_ports:
        - velocity
        - velocity_time
        - position_measured
        output_ports:
        - position_commanded
        - velocity_commanded
        - status

    Port `velocity` (7,) [rad/s] is the command; the optional `velocity_time` (1,) [s] is the time
    at which it was computed. A command counts as zero if it is not connected, not finite or more
    than `PandaDriver.expire_sec` old, or if its time is NaN: the arm then brakes within its
    acceleration limits and holds still, as with the real driver. `position_measured` is (7,) [rad].

    Before the first step, `position_commanded` (7,) [rad] is the measured position and
    `velocity_commanded` (7,) [rad/s] is zero: the arm holds still. `status` (3,) holds the robot
    mode as in `lcmt_panda_status` (always kMove), the age of the status [s] (always 0), and the
    share of commands that reach the robot in time (always 1).
    """

    def __init__(
        self,
        *,
        limits: JointLimits | None = None,
        config: PandaDriver | None = None,
        time_step: float = 1 / 512,
    ):
        """Constructs the driver.

        Args:
            limits: Limits of the joints; None for the Panda's.
            config: How the robot follows commands.
            time_step: The plant's time step [s].
        """
        super().__init__()
        self._limits = limits or PandaModel().joint_limits
        self._config = config or PandaDriver()
        self._time_step = time_step
        self._velocity = self.DeclareVectorInputPort("velocity", NUM_JOINTS)
        self._velocity_time = self.DeclareVectorInputPort("velocity_time", 1)
        self._measured = self.DeclareVectorInputPort("position_measured", NUM_JOINTS)
        # NaN before the first step.
        self._position_index = self.DeclareDiscreteState(np.full(NUM_JOINTS, np.nan))
        self._velocity_index = self.DeclareDiscreteState(np.zeros(NUM_JOINTS))
        self.DeclareVectorOutputPort(
            "position_commanded",
            NUM_JOINTS,
            self._calc_position,
            {self.discrete_state_ticket(self._position_index), self._measured.ticket()},
        )
        self.DeclareStateOutputPort("velocity_commanded", self._velocity_index)
        self.DeclareVectorOutputPort("status", 3, self._calc_status, {self.nothing_ticket()})
        self.DeclarePeriodicDiscreteUpdateEvent(time_step, 0.0, self._step)

    def Reset(self, context: Context) -> None:
        """Forgets the commanded position, so that the next step starts from the measured position.

        Call it with this system's context after setting the plant's positions.
        """
        context.SetDiscreteState(self._position_index, np.full(NUM_JOINTS, np.nan))
        context.SetDiscreteState(self._velocity_index, np.zeros(NUM_JOINTS))

    def _step(self, context: Context, state: DiscreteValues) -> None:
        measured = self._measured.Eval(context)
        commanded = state.value(self._position_index)
        wanted = eval_velocity(
            context, self._velocity, self._velocity_time, max_age=self._config.expire_sec
        )
        position, velocity = step_joints(
            position=measured if math.isnan(commanded[0]) else commanded,
            velocity=state.value(self._velocity_index),
            wanted=np.zeros(NUM_JOINTS) if wanted is None else wanted,
            measured=measured,
            limits=self._limits,
            config=self._config,
            time_step=self._time_step,
        )
        state.set_value(self._position_index, position)
        state.set_value(self._velocity_index, velocity)

    def _calc_position(self, context: Context, output: BasicVector) -> None:
        position = context.get_discrete_state(self._position_index).value()
        output.SetFromVector(self._measured.Eval(context) if math.isnan(position[0]) else position)

    def _calc_status(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector([float(RobotMode.MOVE), 0.0, 1.0])
