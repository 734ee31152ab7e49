"""What the drivers of the real Panda and its hand are told, as systems."""

import math
import time
from collections import deque
from typing import NamedTuple

import numpy as np
from pydrake.systems.framework import Context, LeafSystem

from poil_drake.geometry.all_finite import all_finite
from poil_drake.robots.velocity_limiter import JointMotion, VelocityLimiter
from poil_drake.runtime.held_signals import HeldSignals
from poil_drake.systems.lcm.mailbox import LcmMailbox
from poil_drake.systems.lcm.network import MessageNetwork
from poil_drake.systems.lcm.shared_channel import SharedChannel
from poil_drake.systems.panda.lcm_messages import (
    Clock,
    HandStatus,
    PandaStatus,
    encode_hand_command,
    encode_panda_command,
)
from poil_drake.systems.panda.velocity_driver import NUM_JOINTS

_REST = np.zeros(NUM_JOINTS)


class _Instant(NamedTuple):
    """A time by the driver's clock [s since the epoch], and by one that nobody sets [s]."""

    stamp: float
    steady: float


class PandaCommandSender(LeafSystem):
    """Sends joint velocities to the Panda's driver, which stops the arm when they stop coming.

    .. pydrake_system::

        name: PandaCommandSender
        input_ports:
        - velocity
        - velocity_time

    `velocity` (7,) [rad/s] goes out once every period, in a publish event, stamped with the clock's
    time, as the driver drops what is stamped otherwise. Where it is not connected or not finite, or
    the time [s] in `velocity_time`, where that is connected, is more than `max_age` old, the arm
    brakes: rest is said, not merely left to the driver's expiry. Nothing goes out before the first
    status arrived, nor where the period's update was too long ago by the clock: what it found then
    is not so any more, and the next update comes at once. `SendRest` is for the way out.

    It listens to its own channel, too: an event raises a StationError once somebody else has
    commanded the arm.

    Attributes:
        commanding: Whether anything was sent since `SendRest` ended with rest.
        channel: Where it sends.
    """

    def __init__(
        self,
        *,
        lcm: MessageNetwork,
        channel: str,
        mailbox: LcmMailbox[PandaStatus],
        limiter: VelocityLimiter,
        period: float,
        offset: float = 0.0,
        max_age: float = 0.1,
        expiry: float = 0.1,
        update_age: Clock = lambda: 0.0,
        max_update_age: float = 0.08,
        clock: Clock = time.time,
        time_scale: float = 1.0,
    ):
        """Constructs the sender.

        Args:
            lcm: The network.
            channel: The driver's channel for commands.
            mailbox: Where its statuses arrive.
            limiter: How the arm brakes, for the same period.
            period: Between two commands [s].
            offset: Of the first [s]: where it is a part of the period, commands go out so long
                after the update that made them, at an even pace if the loop waits for that.
            max_age: Of a velocity that is still sent [s], by the context's time.
            expiry: For how long the driver follows a command [s of the context's time].
            update_age: Returns how long ago the period's update began [s of the context's time]: a
                process that was halted meanwhile knows it from that.
            max_update_age: What that may be, for anything to be sent [s].
            clock: The time now [s since the epoch], on which the driver must agree.
            time_scale: Seconds of that clock per second.
        """
        super().__init__()
        self.commanding, self._sent_at = False, -math.inf
        self.channel = SharedChannel(lcm, channel, what="the robot")
        # The newest first.
        self._sent: deque[np.ndarray] = deque([_REST] * 2, maxlen=2)
        self._mailbox, self._limiter = mailbox, limiter
        self._period, self._time_scale = period, time_scale
        self._max_age, self._expiry, self._clock = max_age, expiry, clock
        self._update_age, self._max_update_age = update_age, max_update_age
        self._velocity = self.DeclareVectorInputPort("velocity", NUM_JOINTS)
        self._velocity_time = self.DeclareVectorInputPort("velocity_time", 1)
        self.DeclarePeriodicPublishEvent(period, offset, self._send)
        self.DeclareForcedPublishEvent(self._send)

    def SendRest(self, duration: float) -> None:
        """Brakes from what was sent last, sends zero velocities for a while, and waits for both.

        The arm brakes as it does after a fault, by the limiter, and so stays where it may be. Where
        the last command is so old that the driver has stopped the arm, there is nothing to brake
        from. Signals wait until it is over.

        Args:
            duration: How long to send zeros [s], longer than the driver's expiry.
        """
        with HeldSignals():
            if self._mailbox.newest is None:
                return
            period, start = self._period / self._time_scale, time.monotonic()
            velocities = self._limiter.braking(self._motion())
            elapsed = 0.0
            while elapsed < period * len(velocities) + duration:
                now = self._now()
                step = int((now.steady - start) / period)
                self._publish(velocities[step] if step < len(velocities) else _REST, now)
                time.sleep(period)
                elapsed = time.monotonic() - start
            # A process that was halted meanwhile may have sent no rest yet.
            self.commanding = bool(self._sent[0].any())

    def _send(self, context: Context) -> None:
        self.channel.CheckAlone()
        # Before all that is looked at: a process that is halted on the way sends a command that
        # says itself how old it is, and the driver drops it.
        now = self._now()
        if self._mailbox.newest is None or not self._update_age() <= self._max_update_age:
            return
        wanted = self._wanted(context)
        if wanted is None:
            wanted = self._limiter.step(self._motion(), _REST).velocity
        self._publish(wanted, now)

    def _wanted(self, context: Context) -> np.ndarray | None:
        if not self._velocity.HasValue(context):
            return None
        if self._velocity_time.HasValue(context):
            age = context.get_time() - self._velocity_time.Eval(context)[0]
            if not age <= self._max_age:
                return None
        velocity = self._velocity.Eval(context)
        return velocity if all_finite(velocity) else None

    def _motion(self) -> JointMotion:
        """Returns what the arm was told last; rest where the driver has stopped it since.

        Its acceleration is that of the last period: within one, jerks build up all that is allowed.
        """
        newest, before = self._sent
        followed = self._time_scale * (time.monotonic() - self._sent_at) <= self._expiry
        if not (followed and newest.any()):
            return JointMotion.at_rest(_REST)
        largest = self._limiter.acceleration
        acceleration = (newest - before) / self._period
        return JointMotion(_REST, newest, np.clip(acceleration, -largest, largest))

    def _now(self) -> _Instant:
        return _Instant(self._clock(), time.monotonic())

    def _publish(self, velocity: np.ndarray, now: _Instant) -> None:
        self.commanding, self._sent_at = True, now.steady
        self._sent.appendleft(np.array(velocity))
        self.channel.Send(encode_panda_command(velocity, now.stamp))


class HandCommandSender(LeafSystem):
    """Sends the wanted opening to the Panda's hand.

    .. pydrake_system::

        name: HandCommandSender
        input_ports:
        - width

    `width` (1,) [m] goes out once every period, in a publish event; nothing where it is not
    connected or not finite, before the first status of the hand, and where the control period's
    update was too long ago by the clock: it keeps its opening then. The driver grips when the
    opening gets smaller than it is, and ignores what it was told last.

    It listens to its own channel, too: an event raises a StationError once somebody else has
    commanded the hand.

    Attributes:
        channel: Where it sends.
    """

    def __init__(
        self,
        *,
        lcm: MessageNetwork,
        channel: str,
        mailbox: LcmMailbox[HandStatus],
        period: float,
        offset: float = 0.0,
        force: float = 40.0,
        update_age: Clock = lambda: 0.0,
        max_update_age: float = 0.08,
        clock: Clock = time.time,
    ):
        """Constructs the sender.

        Args:
            lcm: The network.
            channel: The driver's channel for commands.
            mailbox: Where the hand's statuses arrive.
            period: Between two commands [s]; the driver looks ten times a second.
            offset: Of the first [s]; above 0, initializing a simulator sends nothing.
            force: Of the grip [N]; the hand can do 70 all the time.
            update_age: See `PandaCommandSender`.
            max_update_age: See `PandaCommandSender`.
            clock: The time now [s since the epoch].
        """
        super().__init__()
        self.channel = SharedChannel(lcm, channel, what="the hand")
        self._mailbox, self._force, self._clock = mailbox, force, clock
        self._update_age, self._max_update_age = update_age, max_update_age
        self._width = self.DeclareVectorInputPort("width", 1)
        self.DeclarePeriodicPublishEvent(period, offset, self._send)
        self.DeclareForcedPublishEvent(self._send)

    def _send(self, context: Context) -> None:
        self.channel.CheckAlone()
        if self._mailbox.newest is None or not self._width.HasValue(context):
            return
        (width,) = self._width.Eval(context).tolist()
        if math.isfinite(width) and self._update_age() <= self._max_update_age:
            self.channel.Send(encode_hand_command(width, self._force, self._clock()))
