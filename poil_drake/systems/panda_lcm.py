"""The real Panda's driver, as systems: what it reports, and what it is told."""

import math
import time
from collections import deque

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from poil_drake.errors import StationError
from poil_drake.geometry.all_finite import all_finite
from poil_drake.systems.held_signals import HeldSignals
from poil_drake.systems.lcm_network import MessageNetwork
from poil_drake.systems.panda_lcm_messages import (
    Clock,
    HandStatus,
    LcmMailbox,
    PandaStatus,
    encode_hand_command,
    encode_panda_command,
)
from poil_drake.systems.panda_velocity_driver import NUM_JOINTS
from poil_drake.systems.statuses import RobotMode

_UNKNOWN, _REST = np.full(NUM_JOINTS, np.nan), np.zeros(NUM_JOINTS)

_HAND_GRACE = 0.1
"""A hand's opening is believed for so long after its status is not any more [s]."""

_REMEMBERED = 1024
"""Own commands that are told from those of others when they come back: four seconds of them."""

_BRAKING = 5.0
"""How fast the arm is brought to rest on the way out [rad/s^2]: each of its joints can do that."""


class PandaStatusReceiver(LeafSystem):
    """Shows the newest status of the Panda's driver.

    .. pydrake_system::

        name: PandaStatusReceiver
        output_ports:
        - position_measured
        - velocity_measured
        - torque_external
        - status

    Every output is state, taken from the mailbox once every period, in an unrestricted update, so
    that the discrete updates of the same instant see it. `position_measured` [rad],
    `velocity_measured` [rad/s] and `torque_external` [N m] are (7,), NaN before the first status.
    `status` (3,) holds the `RobotMode`, the age [s] and the share of commands that reach the robot
    in time. The age is by the driver's stamp, at the last update: it grows when statuses stop,
    arrive late or are repeated, and is negative where the driver's clock is ahead of ours. Before
    the first status these are OTHER, infinity and 0.
    """

    def __init__(
        self, *, mailbox: LcmMailbox[PandaStatus], period: float, clock: Clock = time.time
    ):
        """Constructs the receiver.

        Args:
            mailbox: Where statuses arrive.
            period: Of its looks at it [s].
            clock: The time now [s since the epoch].
        """
        super().__init__()
        self._mailbox, self._clock = mailbox, clock
        self._seen = self.DeclareAbstractState(Value[object]((None, np.inf)))
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._look)
        known = {self.abstract_state_ticket(self._seen)}
        for name in ("position", "velocity", "torque_external"):
            port = f"{name}_measured" if name != "torque_external" else name

            def calc(context: Context, output: BasicVector, name: str = name) -> None:
                status, _ = self._status(context)
                output.SetFromVector(_UNKNOWN if status is None else getattr(status, name))

            self.DeclareVectorOutputPort(port, NUM_JOINTS, calc, known)
        self.DeclareVectorOutputPort("status", 3, self._calc_status, known)

    def _status(self, context: Context) -> tuple[PandaStatus | None, float]:
        return context.get_abstract_state(self._seen).get_value()

    def _look(self, context: Context, state: State) -> None:
        status = self._mailbox.newest
        age = np.inf if status is None else self._clock() - status.stamp
        state.get_mutable_abstract_state(self._seen).set_value((status, age))

    def _calc_status(self, context: Context, output: BasicVector) -> None:
        status, age = self._status(context)
        if status is None:
            output.SetFromVector([float(RobotMode.OTHER), np.inf, 0.0])
        else:
            output.SetFromVector([float(status.mode), age, status.success_rate])


class PandaCommandSender(LeafSystem):
    """Sends joint velocities to the Panda's driver, which stops the arm when they stop coming.

    .. pydrake_system::

        name: PandaCommandSender
        input_ports:
        - velocity
        - velocity_time

    `velocity` (7,) [rad/s] goes out once every period, in a publish event, stamped with the clock's
    time, as the driver drops what is stamped otherwise. Zero goes out where it is not connected or
    not finite, or the time [s] in `velocity_time`, where that is connected, is more than `max_age`
    old, or the update was too long ago by the clock: rest is said, not merely left to the driver's
    expiry. Before the first status arrived nothing is sent. `SendRest` is for the way out.

    It listens to its own channel, too: an event raises a StationError once somebody else has
    commanded the arm.

    Attributes:
        commanded: Whether anything was sent yet.
        foreign: How many commands of others came.
    """

    def __init__(
        self,
        *,
        lcm: MessageNetwork,
        channel: str,
        mailbox: LcmMailbox[PandaStatus],
        period: float,
        offset: float = 0.0,
        max_age: float = 0.1,
        update_age: Clock = lambda: 0.0,
        max_update_age: float = 0.02,
        clock: Clock = time.time,
    ):
        """Constructs the sender.

        Args:
            lcm: The network.
            channel: The driver's channel for commands.
            mailbox: Where its statuses arrive.
            period: Between two commands [s].
            offset: Of the first [s]: where it is a part of the period, commands go out so long
                after the update that made them, at an even pace if the loop waits for that.
            max_age: Of a velocity that is still sent [s], by the context's time.
            update_age: Returns how long ago the period's update began [s of the context's time]: a
                process that was halted meanwhile knows it from that.
            max_update_age: What that may be, for a velocity that is still sent [s].
            clock: The time now [s since the epoch], on which the driver must agree.
        """
        super().__init__()
        self.commanded, self._last, self._sent_at = False, _REST, -math.inf
        self.foreign = 0
        self._own: deque[bytes] = deque(maxlen=_REMEMBERED)
        self._lcm, self._channel, self._mailbox = lcm, channel, mailbox
        self._max_age, self._clock = max_age, clock
        self._update_age, self._max_update_age = update_age, max_update_age
        self._velocity = self.DeclareVectorInputPort("velocity", NUM_JOINTS)
        self._velocity_time = self.DeclareVectorInputPort("velocity_time", 1)
        lcm.Subscribe(channel, self._hear)
        self.DeclarePeriodicPublishEvent(period, offset, self._send)
        self.DeclareForcedPublishEvent(self._send)

    def SendRest(self, duration: float, *, period: float = 0.004) -> None:
        """Brakes from what was sent last, sends zero velocities for a while, and waits for both.

        Where the last command is so old that the driver may have stopped the arm, there is nothing
        to brake from. Signals wait until it is over.

        Args:
            duration: How long to send zeros [s], longer than the driver's expiry.
            period: Between two commands [s].
        """
        with HeldSignals():
            start = time.monotonic()
            velocity = self._last if start - self._sent_at <= 0.5 * self._max_age else _REST
            braking = float(np.abs(velocity).max()) / _BRAKING
            elapsed = 0.0
            while self._mailbox.newest is not None and elapsed < braking + duration:
                left = 1.0 - elapsed / braking if elapsed < braking else 0.0
                self._publish(left * velocity)
                time.sleep(period)
                elapsed = time.monotonic() - start

    def CheckAlone(self) -> None:
        """Raises a StationError if somebody else has commanded the arm."""
        if self.foreign:
            raise StationError(
                f"Somebody else commands the robot on {self._channel}.",
                remedy="End the other run first; it may be halted in the background.",
            )

    def _hear(self, message: bytes) -> None:
        if message not in self._own:
            self.foreign += 1

    def _send(self, context: Context) -> None:
        self.CheckAlone()
        if self._mailbox.newest is not None:
            self._publish(self._wanted(context))

    def _wanted(self, context: Context) -> np.ndarray:
        if not self._velocity.HasValue(context) or not self._update_age() <= self._max_update_age:
            return _REST
        if self._velocity_time.HasValue(context):
            age = context.get_time() - self._velocity_time.Eval(context)[0]
            if not age <= self._max_age:
                return _REST
        velocity = self._velocity.Eval(context)
        return velocity if all_finite(velocity) else _REST

    def _publish(self, velocity: np.ndarray) -> None:
        self.commanded, self._last, self._sent_at = True, np.array(velocity), time.monotonic()
        message = encode_panda_command(velocity, self._clock())
        # The newest first: its echo is what will be heard.
        self._own.appendleft(message)
        self._lcm.Publish(self._channel, message)


class HandStatusReceiver(LeafSystem):
    """Shows how far the Panda's hand is open.

    .. pydrake_system::

        name: HandStatusReceiver
        output_ports:
        - width_measured

    `width_measured` (1,) [m] is state, taken from the mailbox once every period, in an unrestricted
    update. It is NaN before the first status, and once the newest has been more than `max_age` off
    the clock by its stamp for a while: what stops the whole robot is for others to say first.
    """

    def __init__(
        self,
        *,
        mailbox: LcmMailbox[HandStatus],
        period: float,
        max_age: float = 0.5,
        clock: Clock = time.time,
    ):
        """Constructs the receiver.

        Args:
            mailbox: Where statuses arrive.
            period: Of its looks at it [s].
            max_age: Of a status that is still believed [s]. The driver sends ten a second.
            clock: The time now [s since the epoch].
        """
        super().__init__()
        self._mailbox, self._max_age, self._clock = mailbox, max_age, clock
        # The width, and when it was last known.
        self._width = self.DeclareAbstractState(Value[object]((np.nan, -np.inf)))
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._look)
        self.DeclareVectorOutputPort(
            "width_measured", 1, self._calc_width, {self.abstract_state_ticket(self._width)}
        )

    def _look(self, context: Context, state: State) -> None:
        status = self._mailbox.newest
        known = status is not None and abs(self._clock() - status.stamp) <= self._max_age
        width, known_at = context.get_abstract_state(self._width).get_value()
        if status is not None and known:
            width, known_at = status.width, context.get_time()
        elif context.get_time() - known_at > _HAND_GRACE:
            width = np.nan
        state.get_mutable_abstract_state(self._width).set_value((width, known_at))

    def _calc_width(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector([context.get_abstract_state(self._width).get_value()[0]])


class HandCommandSender(LeafSystem):
    """Sends the wanted opening to the Panda's hand.

    .. pydrake_system::

        name: HandCommandSender
        input_ports:
        - width

    `width` (1,) [m] goes out once every period, in a publish event; nothing where it is not
    connected or not finite, and before the first status of the hand: it keeps its opening then. The
    driver grips when the opening gets smaller than it is, and ignores what it was told last.
    """

    def __init__(
        self,
        *,
        lcm: MessageNetwork,
        channel: str,
        mailbox: LcmMailbox[HandStatus],
        period: float,
        force: float = 40.0,
        clock: Clock = time.time,
    ):
        """Constructs the sender.

        Args:
            lcm: The network.
            channel: The driver's channel for commands.
            mailbox: Where the hand's statuses arrive.
            period: Between two commands [s]; the driver looks ten times a second.
            force: Of the grip [N]; the hand can do 70 all the time.
            clock: The time now [s since the epoch].
        """
        super().__init__()
        self._lcm, self._channel, self._mailbox = lcm, channel, mailbox
        self._force, self._clock = force, clock
        self._width = self.DeclareVectorInputPort("width", 1)
        self.DeclarePeriodicPublishEvent(period, 0.0, self._send)
        self.DeclareForcedPublishEvent(self._send)

    def _send(self, context: Context) -> None:
        if self._mailbox.newest is None or not self._width.HasValue(context):
            return
        (width,) = self._width.Eval(context).tolist()
        if np.isfinite(width):
            self._lcm.Publish(self._channel, encode_hand_command(width, self._force, self._clock()))
