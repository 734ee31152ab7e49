"""A simulated Franka driver's end of the network: takes commands, reports the arm's status."""

import time
from dataclasses import dataclass

import numpy as np
from pydrake.common.value import Value
from pydrake.manipulation import PandaControlMode
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from poil_drake.errors import InvalidValueError, StationError
from poil_drake.systems.lcm.network import MessageNetwork
from poil_drake.systems.panda.lcm_messages import (
    Clock,
    PandaCommand,
    PandaStatus,
    decode_panda_command,
    encode_panda_status,
)
from poil_drake.systems.panda.velocity_driver import NUM_JOINTS
from poil_drake.systems.statuses import RobotMode

_SIZES = (0, NUM_JOINTS, 0)


@dataclass(frozen=True, kw_only=True)
class SimulatedDriverConfig:
    """How the simulated driver behaves.

    Attributes:
        expire_sec: A command whose stamp is farther than this from the driver's clock is dropped
            [s], as by the real one.
        torque_limit: External torque on a joint at which the robot's reflex stops it [N m]; the
            real driver's default is 100, Franka's examples have 20.
        reflex_sec: For so long a reflex is reported before the driver ends [s].
        status_period: Between two statuses [s]; the real driver sends a thousand a second, and this
            is exact in binary.
    """

    expire_sec: float = 0.1
    torque_limit: float = 100.0
    reflex_sec: float = 0.1
    status_period: float = 1 / 1024


class _Taken:
    """What came in since the last look: the last command wins, as in the real driver."""

    def __init__(self) -> None:
        self.last: PandaCommand | None = None

    def __call__(self, message: bytes) -> None:
        try:
            self.last = decode_panda_command(message)
        except InvalidValueError:
            return  # LCM itself drops what has another type.


class SimulatedDriver(LeafSystem):
    """Takes velocity commands from the network and reports the arm's status, as the real one does.

    .. pydrake_system::

        name: SimulatedDriver
        input_ports:
        - position_measured
        - velocity_measured
        - torque_external
        - velocity_commanded
        output_ports:
        - velocity
        - velocity_time

    Once every period, that of the plant, the last command that came in is looked at. With another
    control mode than velocity, or another size, the driver ends (a StationError), like the real
    one. A command whose stamp is more than `expire_sec` off the driver's clock is dropped. Statuses
    go out at a rate of their own, with all joints' values as in `lcmt_panda_status`; between two
    steps of the plant the position is carried on by the velocity.

    `velocity` (7,) [rad/s] is that of the last command, zero before the first; `velocity_time` (1,)
    [s] is the simulation's time at which it was stamped, minus infinity before the first, so that
    the arm rests once it is older than the arm's own expiry. With an external torque above the
    limit the robot's reflex stops the arm: `velocity` is zero from then on, the mode that is
    reported is REFLEX, and after `reflex_sec` the driver ends.
    """

    def __init__(
        self,
        *,
        lcm: MessageNetwork,
        command_channel: str,
        status_channel: str,
        period: float,
        config: SimulatedDriverConfig | None = None,
        clock: Clock = time.time,
    ):
        """Constructs the driver.

        Args:
            lcm: The network; whoever owns it handles its subscriptions.
            command_channel: Where commands come from.
            status_channel: Where statuses go.
            period: Of the plant, and of looking at commands [s].
            config: Its behaviour.
            clock: The driver's time [s since the epoch].
        """
        super().__init__()
        self._lcm, self._channel, self._clock = lcm, status_channel, clock
        self._config = config or SimulatedDriverConfig()
        self._taken = _Taken()
        lcm.Subscribe(command_channel, self._taken)
        names = ("position_measured", "velocity_measured", "torque_external", "velocity_commanded")
        self._inputs = {name: self.DeclareVectorInputPort(name, NUM_JOINTS) for name in names}
        # Velocity, its time, and when the reflex stopped the arm.
        start = (np.zeros(NUM_JOINTS), -np.inf, np.inf)
        self._state = self.DeclareAbstractState(Value[object](start))
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._look)
        self._period = period
        self.DeclarePeriodicPublishEvent(self._config.status_period, 0.0, self._report)
        known = {self.abstract_state_ticket(self._state)}
        self.DeclareVectorOutputPort("velocity", NUM_JOINTS, self._calc_velocity, known)
        self.DeclareVectorOutputPort("velocity_time", 1, self._calc_time, known)

    def _memory(self, context: Context) -> tuple[np.ndarray, float, float]:
        return context.get_abstract_state(self._state).get_value()

    def _look(self, context: Context, state: State) -> None:
        velocity, stamped, reflex = self._memory(context)
        now = context.get_time()
        if now - reflex >= self._config.reflex_sec:
            raise StationError(
                "The robot's reflex stopped the arm: the external torque was above "
                f"{self._config.torque_limit} N m.",
                remedy="Take away what it touches, and start the driver again.",
            )
        command, self._taken.last = self._taken.last, None
        if command is not None:
            if command.mode != int(PandaControlMode.kVelocity) or command.sizes != _SIZES:
                raise StationError(
                    f"A command expects the control mode {command.mode}, with {command.sizes} "
                    "positions, velocities and torques.",
                    remedy="Send seven velocities in velocity mode (2).",
                )
            age = self._clock() - command.stamp
            if abs(age) <= self._config.expire_sec and np.isfinite(command.velocity).all():
                velocity, stamped = command.velocity, now - age
        torque = np.abs(self._inputs["torque_external"].Eval(context)).max()
        if reflex == np.inf and torque > self._config.torque_limit:
            reflex = now
        if reflex < np.inf:
            velocity, stamped = np.zeros(NUM_JOINTS), -np.inf
        state.get_mutable_abstract_state(self._state).set_value((velocity, stamped, reflex))

    def _report(self, context: Context) -> None:
        seen = {name: port.Eval(context) for name, port in self._inputs.items()}
        reflex = self._memory(context)[2]
        since_step = context.get_time() % self._period
        status = PandaStatus(
            stamp=self._clock(),
            position=seen["position_measured"] + since_step * seen["velocity_measured"],
            velocity=seen["velocity_measured"],
            torque_external=seen["torque_external"],
            mode=RobotMode.MOVE if reflex == np.inf else RobotMode.REFLEX,
            success_rate=float(reflex == np.inf),
        )
        self._lcm.Publish(self._channel, encode_panda_status(status, seen["velocity_commanded"]))

    def _calc_velocity(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._memory(context)[0])

    def _calc_time(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector([self._memory(context)[1]])
