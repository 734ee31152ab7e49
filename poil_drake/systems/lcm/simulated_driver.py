"""The network side of a simulated Franka driver: accepts commands, reports the arm's status."""

import time
from dataclasses import dataclass

import numpy as np
from pydrake.manipulation import PandaControlMode
from pydrake.systems.framework import Context, LeafSystem, State

from poil_drake.errors import InvalidValueError, StationError
from poil_drake.robots.panda import NUM_JOINTS
from poil_drake.systems.lcm.network import Clock, MessageNetwork
from poil_drake.systems.lcm.panda_messages import (
    PandaChannels,
    PandaCommand,
    PandaStatus,
    decode_panda_command,
    encode_panda_status,
)
from poil_drake.systems.statuses import RobotMode

_SIZES = (0, NUM_JOINTS, 0)

_REFLEX_SEC = 0.1
"""How long the driver reports a reflex before the driver ends [s]."""


@dataclass(frozen=True, kw_only=True)
class SimulatedDriverConfig:
    """How the simulated driver behaves.

    Attributes:
        expire_sec: The driver drops a command whose stamp differs from its clock by more than this
            [s], as the real one does.
        torque_limit: External torque on a joint at which the robot's reflex stops the arm [N m];
            the real driver's default is 100, Franka's examples use 20.
        status_period: Time between two statuses [s]. The real driver sends 1000 statuses a second;
            1/1024 s is exact in binary.
    """

    expire_sec: float = 0.1
    torque_limit: float = 100.0
    status_period: float = 1 / 1024


class SimulatedDriver(LeafSystem):
    """Accepts velocity commands over the network and reports the arm's status.

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

    Drake's `PandaCommandReceiver` does not check the age of a command and has no reflex. Its
    `PandaStatusSender` has no robot mode and stamps statuses with the context's time.

    Once per period of the plant, the driver reads the last command. A command that is not in
    velocity mode, or does not hold seven velocities, ends the driver with a StationError, as it
    ends the real driver. The driver drops a command that is not finite, or whose stamp differs from
    its clock by more than `expire_sec`. It sends an `lcmt_panda_status` every `status_period`;
    between two steps of the plant it extrapolates the positions with the velocities.

    `velocity` (7,) [rad/s] is the velocity in the last accepted command, zero before the first.
    `velocity_time` (1,) [s] is the simulation time at that command's stamp, minus infinity before
    the first; from it `PandaVelocityDriver` detects an old command. An external torque above
    `torque_limit` triggers the robot's reflex: `velocity` is zero from then on, the driver reports
    the mode REFLEX, and ends with a StationError 0.1 s later.
    """

    def __init__(
        self,
        *,
        lcm: MessageNetwork,
        command_channel: str = PandaChannels.command,
        status_channel: str = PandaChannels.status,
        period: float = 1 / 512,
        config: SimulatedDriverConfig | None = None,
        clock: Clock = time.time,
    ):
        """Constructs the driver.

        Args:
            lcm: The network; its owner calls `HandleSubscriptions`.
            command_channel: The channel of the commands.
            status_channel: The channel of the statuses.
            period: Period of the plant, and of reading commands [s].
            config: The driver's behaviour.
            clock: The driver's time [s since the epoch].
        """
        super().__init__()
        self._lcm, self._channel, self._clock = lcm, status_channel, clock
        self._config = config or SimulatedDriverConfig()
        self._period = period
        self._last_command: PandaCommand | None = None
        lcm.Subscribe(command_channel, self._receive)
        names = ("position_measured", "velocity_measured", "torque_external", "velocity_commanded")
        self._inputs = {name: self.DeclareVectorInputPort(name, NUM_JOINTS) for name in names}
        self._velocity = self.DeclareDiscreteState(np.zeros(NUM_JOINTS))
        self._velocity_time = self.DeclareDiscreteState([-np.inf])
        self._reflex_time = self.DeclareDiscreteState([np.inf])
        self.DeclareStateOutputPort("velocity", self._velocity)
        self.DeclareStateOutputPort("velocity_time", self._velocity_time)
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._update)
        self.DeclarePeriodicPublishEvent(self._config.status_period, 0.0, self._report)

    def _receive(self, message: bytes) -> None:
        try:
            self._last_command = decode_panda_command(message)
        except InvalidValueError:
            return  # LCM itself drops messages of another type.

    def _update(self, context: Context, state: State) -> None:
        discrete_state, now = state.get_mutable_discrete_state(), context.get_time()
        reflex_time = discrete_state.value(self._reflex_time)[0]
        if now - reflex_time >= _REFLEX_SEC:
            raise StationError(
                "The robot's reflex stopped the arm: the external torque was above "
                f"{self._config.torque_limit} N m.",
                remedy="Remove the contact, and start the driver again.",
            )
        command, self._last_command = self._last_command, None
        if command is not None:
            if command.mode != int(PandaControlMode.kVelocity) or command.sizes != _SIZES:
                raise StationError(
                    f"The driver cannot follow a command with the control mode {command.mode} and "
                    f"{command.sizes} positions, velocities and torques.",
                    remedy="Send seven velocities in velocity mode (2).",
                )
            age = self._clock() - command.stamp
            if abs(age) <= self._config.expire_sec and np.isfinite(command.velocity).all():
                discrete_state.set_value(self._velocity, command.velocity)
                discrete_state.set_value(self._velocity_time, [now - age])
        torque = np.abs(self._inputs["torque_external"].Eval(context)).max()
        if torque > self._config.torque_limit:
            reflex_time = min(reflex_time, now)
        if reflex_time < np.inf:
            discrete_state.set_value(self._velocity, np.zeros(NUM_JOINTS))
            discrete_state.set_value(self._velocity_time, [-np.inf])
            discrete_state.set_value(self._reflex_time, [reflex_time])

    def _report(self, context: Context) -> None:
        values = {name: port.Eval(context) for name, port in self._inputs.items()}
        in_reflex = context.get_discrete_state(self._reflex_time)[0] < np.inf
        since_step = context.get_time() % self._period
        status = PandaStatus(
            stamp=self._clock(),
            position=values["position_measured"] + since_step * values["velocity_measured"],
            velocity=values["velocity_measured"],
            torque_external=values["torque_external"],
            mode=RobotMode.REFLEX if in_reflex else RobotMode.MOVE,
            success_rate=float(not in_reflex),
        )
        self._lcm.Publish(self._channel, encode_panda_status(status, values["velocity_commanded"]))
