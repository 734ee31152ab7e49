"""The network side of the simulated drivers of the Franka arm and its hand."""

import time
from contextlib import suppress

import numpy as np
from pydrake.manipulation import PandaControlMode
from pydrake.systems.framework import Context, LeafSystem, State

from poil_drake.errors import InvalidValueError, StationError
from poil_drake.robots.panda import NUM_JOINTS
from poil_drake.systems.lcm.mailbox import LcmMailbox
from poil_drake.systems.lcm.network import Clock, MessageNetwork
from poil_drake.systems.lcm.panda_messages import (
    HAND_PERIOD,
    HandOpening,
    PandaChannels,
    PandaCommand,
    PandaStatus,
    decode_hand_command,
    decode_panda_command,
    encode_hand_status,
    encode_panda_status,
)
from poil_drake.systems.statuses import RobotMode

_SIZES = (0, NUM_JOINTS, 0)

_REFLEX_SEC = 0.1
"""How long the driver reports a reflex before the driver ends [s]."""

_TORQUE_LIMIT = 100.0
"""External torque on a joint at which the robot's reflex stops the arm [N m]: the real driver's
default; Franka's examples use 20."""

STATUS_PERIOD = 1 / 1024
"""Time between two statuses [s]. The real driver sends 1000 statuses a second; 1/1024 s is exact in
binary."""

_STILL = 5e-4
"""A hand that moves less than this in a period has ended its motion [m]."""


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
    its clock by more than `expiry`. It sends 1024 `lcmt_panda_status` a second; between two steps
    of the plant it extrapolates the positions with the velocities.

    `velocity` (7,) [rad/s] is the velocity in the last accepted command, zero before the first.
    `velocity_time` (1,) [s] is the simulation time at that command's stamp, minus infinity before
    the first; from it `PandaVelocityDriver` detects an old command. An external torque above
    100 N m triggers the robot's reflex: `velocity` is zero from then on, the driver reports the
    mode REFLEX, and ends with a StationError 0.1 s later.
    """

    def __init__(
        self,
        *,
        lcm: MessageNetwork,
        command_channel: str = PandaChannels.command,
        status_channel: str = PandaChannels.status,
        period: float = 1 / 512,
        expiry: float = 0.1,
        clock: Clock = time.time,
    ):
        """Constructs the driver.

        Args:
            lcm: The network; its owner calls `HandleSubscriptions`.
            command_channel: The channel of the commands.
            status_channel: The channel of the statuses.
            period: Period of the plant, and of reading commands [s].
            expiry: Largest difference between a command's stamp and the driver's clock [s].
            clock: The driver's time [s since the epoch].
        """
        super().__init__()
        self._lcm, self._channel, self._clock = lcm, status_channel, clock
        self._period, self._expiry = period, expiry
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
        self.DeclarePeriodicPublishEvent(STATUS_PERIOD, 0.0, self._report)

    def _receive(self, message: bytes) -> None:
        with suppress(InvalidValueError):  # LCM itself drops messages of another type.
            self._last_command = decode_panda_command(message)

    def _update(self, context: Context, state: State) -> None:
        discrete_state, now = state.get_mutable_discrete_state(), context.get_time()
        reflex_time = discrete_state.value(self._reflex_time)[0]
        if now - reflex_time >= _REFLEX_SEC:
            raise StationError(
                "The robot's reflex stopped the arm: the external torque was above "
                f"{_TORQUE_LIMIT} N m.",
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
            if abs(age) <= self._expiry and np.isfinite(command.velocity).all():
                discrete_state.set_value(self._velocity, command.velocity)
                discrete_state.set_value(self._velocity_time, [now - age])
        torque = np.abs(self._inputs["torque_external"].Eval(context)).max()
        if torque > _TORQUE_LIMIT:
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


class SimulatedHand(LeafSystem):
    """Accepts opening commands over the network and reports the opening ten times a second.

    .. pydrake_system::

        name: SimulatedHand
        input_ports:
        - width_measured
        output_ports:
        - width

    Like the real driver it runs one loop at 10 Hz, ignores a command that repeats the last one,
    reads no command while the hand moves, and reports no force. `width` (1,) [m] is the last
    commanded opening; before the first command it is NaN, and the hand holds its opening.
    """

    def __init__(
        self,
        *,
        lcm: MessageNetwork,
        command_channel: str = PandaChannels.hand_command,
        status_channel: str = PandaChannels.hand_status,
        clock: Clock = time.time,
    ):
        """Constructs the driver.

        Args:
            lcm: The network; its owner calls `HandleSubscriptions`.
            command_channel: The channel of the commands.
            status_channel: The channel of the statuses.
            clock: The driver's time [s since the epoch].
        """
        super().__init__()
        self._lcm, self._channel, self._clock = lcm, status_channel, clock
        self._mailbox = LcmMailbox(lcm, command_channel, decode_hand_command)
        self._measured = self.DeclareVectorInputPort("width_measured", 1)
        self._target = self.DeclareDiscreteState([np.nan])
        self.DeclareStateOutputPort("width", self._target)
        # The measured opening at the last update [m], and 1 while the hand is moving.
        self._last = self.DeclareDiscreteState([np.nan, 0.0])
        self.DeclarePeriodicUnrestrictedUpdateEvent(HAND_PERIOD, 0.0, self._update)
        self.DeclarePeriodicPublishEvent(HAND_PERIOD, 0.0, self._report)

    def _update(self, context: Context, state: State) -> None:
        discrete_state, command = state.get_mutable_discrete_state(), self._mailbox.newest
        width = self._measured.Eval(context)[0]
        last_width, moving = discrete_state.value(self._last)
        busy = bool(moving) and abs(width - last_width) > _STILL
        target = discrete_state.value(self._target)[0]
        if not busy and command is not None and command.width != target:
            discrete_state.set_value(self._target, [command.width])
            busy = True
        discrete_state.set_value(self._last, [width, float(busy)])

    def _report(self, context: Context) -> None:
        opening = HandOpening(stamp=self._clock(), width=float(self._measured.Eval(context)[0]))
        busy = bool(context.get_discrete_state(self._last)[1])
        self._lcm.Publish(self._channel, encode_hand_status(opening, busy))
