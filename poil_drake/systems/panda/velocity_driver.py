"""The simulated Panda's velocity interface: what the real robot's driver does to a command."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem

from poil_drake.errors import InvalidValueError
from poil_drake.robots.joint_limits import JointLimits

NUM_JOINTS = 7
ROBOT_MODE_MOVE = 2.0
"""`lcmt_panda_status.kMove`: the robot follows commands."""

_REST = (0.0,) * NUM_JOINTS


@dataclass(frozen=True, kw_only=True)
class PandaDriver:
    """How the simulated robot follows velocity commands.

    Attributes:
        expire_sec: A command older than this [s] means zero velocity, as in the real driver.
        low_pass_hz: Cut-off of the first-order filter on commands [Hz], as in the real driver.
        leash: Largest difference between commanded and measured position [rad]: a blocked arm
            pushes no harder than stiffness * leash, and does not run away when it comes free.
        limit_margin: Distance that is kept from the joints' position limits [rad].
        stiffness: Joint stiffness [N m / rad]; libfranka's default joint impedance.
        damping: Joint damping [N m s / rad]; about critical for the arm's own inertia.
        hand_stiffness: Of the fingers' drive [N / m]: so stiff that the force limit decides.
        hand_damping: Of the fingers' drive [N s / m].
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
                    remedy=f"Give {NUM_JOINTS}, one for each joint of the arm.",
                )
        positive = ("expire_sec", "low_pass_hz", "leash", "hand_stiffness", "hand_speed")
        values = {name: (getattr(self, name),) for name in positive} | {"stiffness": self.stiffness}
        others = {name: (getattr(self, name),) for name in ("limit_margin", "hand_damping")}
        for name, numbers in (values | others | {"damping": self.damping}).items():
            lowest = min(numbers)
            if (
                not all(map(math.isfinite, numbers))
                or lowest < 0
                or (lowest == 0 and name in values)
            ):
                raise InvalidValueError(
                    f"PandaDriver.{name} is {numbers[0] if len(numbers) == 1 else numbers}.",
                    remedy="It must be finite and "
                    + ("positive." if name in values else "not negative."),
                )


@dataclass(frozen=True, kw_only=True)
class JointStep:
    """The constants of one joint in `step_joint`.

    Attributes:
        lower: Smallest position, margin included [rad].
        upper: Largest position, margin included [rad].
        speed: Largest speed [rad/s].
        acceleration: Largest acceleration [rad/s^2].
        smoothing: Share of the way to the wanted velocity that the low pass goes in a step.
        leash: Largest distance from the measured position [rad].
        time_step: Length of the step [s].
    """

    lower: float
    upper: float
    speed: float
    acceleration: float
    smoothing: float
    leash: float
    time_step: float


def joint_steps(
    *, limits: JointLimits, config: PandaDriver, time_step: float
) -> tuple[JointStep, ...]:
    """Returns the constants of every joint."""
    rate = 2 * math.pi * config.low_pass_hz * time_step
    return tuple(
        JointStep(
            lower=lower + config.limit_margin,
            upper=upper - config.limit_margin,
            speed=speed,
            acceleration=acceleration,
            smoothing=rate / (1 + rate),
            leash=config.leash,
            time_step=time_step,
        )
        for lower, upper, speed, acceleration in zip(
            limits.lower.tolist(),
            limits.upper.tolist(),
            limits.velocity.tolist(),
            limits.acceleration.tolist(),
            strict=True,
        )
    )


def step_joint(
    joint: JointStep, *, position: float, velocity: float, wanted: float, measured: float
) -> tuple[float, float]:
    """Advances a joint's commanded position by one step.

    The wanted velocity passes a low pass, then limits of speed, braking distance before the
    position limits, and acceleration; each joint for itself, as libfranka's rate limiter does.
    Plain numbers, as this runs at every step of the plant: seven are quicker than arrays of seven.

    Args:
        joint: The joint's constants.
        position: Commanded position so far [rad].
        velocity: Its velocity so far [rad/s].
        wanted: The velocity asked for [rad/s], finite.
        measured: Measured position [rad].

    Returns:
        The commanded position and velocity after the step.
    """
    change = joint.acceleration * joint.time_step
    limited = velocity + joint.smoothing * (wanted - velocity)
    if limited > 0.0:
        limited = min(limited, joint.speed, _braking_speed(joint.upper - position, joint, change))
    elif limited < 0.0:
        limited = max(limited, -joint.speed, -_braking_speed(position - joint.lower, joint, change))
    limited = min(max(limited, velocity - change), velocity + change)
    wished = position + joint.time_step * limited
    floor = max(joint.lower, measured - joint.leash)
    ceiling = min(joint.upper, measured + joint.leash)
    reached = min(max(wished, floor), ceiling)
    # What a limit took away is not left in the velocity, or it would be wound up.
    return reached, limited if reached == wished else 0.0


def _braking_speed(room: float, joint: JointStep, change: float) -> float:
    """Returns the speed from which a joint can stop within the room left [rad].

    v dt + v^2 / (2 a) = room: the step that is made at this speed, and braking after it.
    """
    return math.sqrt(change * change + 2 * joint.acceleration * max(room, 0.0)) - change


class PandaVelocityDriver(LeafSystem):
    """Turns velocity commands into the desired state of the simulated arm's joint controllers.

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

    Port `velocity` is (7,) [rad/s]. It means zero when it is not connected, holds a NaN, or when
    `velocity_time` is connected and the stamp [s] in it is NaN or more than `expire_sec` old: the
    arm then brakes within its acceleration limits and holds still, as the real driver does.
    `position_measured` is (7,) [rad].

    Before the first step `position_commanded` is the measured position and `velocity_commanded`
    is zero: the arm holds still wherever it stands. `status` is (3,): the robot mode as in
    `lcmt_panda_status` (always kMove), the age of this report [s] (always 0), and the share of
    commands that reach the robot in time (always 1).
    """

    def __init__(self, *, limits: JointLimits, config: PandaDriver, time_step: float):
        super().__init__()
        self._config = config
        self._joints = joint_steps(limits=limits, config=config, time_step=time_step)
        self._velocity = self.DeclareVectorInputPort("velocity", NUM_JOINTS)
        self._velocity_time = self.DeclareVectorInputPort("velocity_time", 1)
        self._measured = self.DeclareVectorInputPort("position_measured", NUM_JOINTS)
        # NaN stands for "not stepped yet".
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
        """Forgets the commanded position, so that the arm holds where it is measured next.

        To be called with this system's context after the plant's positions were set by hand.
        """
        context.SetDiscreteState(self._position_index, np.full(NUM_JOINTS, np.nan))
        context.SetDiscreteState(self._velocity_index, np.zeros(NUM_JOINTS))

    def _wanted_velocity(self, context: Context) -> Sequence[float]:
        if not self._velocity.HasValue(context):
            return _REST
        if self._velocity_time.HasValue(context):
            age = context.get_time() - self._velocity_time.Eval(context)[0]
            if not age <= self._config.expire_sec:
                return _REST
        wanted = self._velocity.Eval(context).tolist()
        return wanted if all(map(math.isfinite, wanted)) else _REST

    def _step(self, context: Context, state: DiscreteValues) -> None:
        measured = self._measured.Eval(context)
        commanded = state.get_mutable_value(self._position_index)
        velocity = state.get_mutable_value(self._velocity_index)
        position = measured if math.isnan(commanded[0]) else commanded
        stepped = [
            step_joint(joint, position=q, velocity=v, wanted=u, measured=m)
            for joint, q, v, u, m in zip(
                self._joints,
                position.tolist(),
                velocity.tolist(),
                self._wanted_velocity(context),
                measured.tolist(),
                strict=True,
            )
        ]
        commanded[:], velocity[:] = zip(*stepped, strict=True)

    def _calc_position(self, context: Context, output: BasicVector) -> None:
        position = context.get_discrete_state(self._position_index).value()
        output.SetFromVector(self._measured.Eval(context) if math.isnan(position[0]) else position)

    def _calc_status(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector([ROBOT_MODE_MOVE, 0.0, 1.0])
