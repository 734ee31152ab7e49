"""Systems that send commands to the drivers of the real Panda and its hand."""

import math
import time
from collections import deque
from collections.abc import Callable

import numpy as np
from pydrake.systems.framework import Context, LeafSystem

from poil_drake.robots.panda import NUM_JOINTS
from poil_drake.robots.velocity_limiter import JointMotion, VelocityLimiter
from poil_drake.runtime.held_signals import HeldSignals
from poil_drake.systems.control_period import CONTROL_PERIOD
from poil_drake.systems.lcm.mailbox import LcmMailbox, SharedChannel
from poil_drake.systems.lcm.network import Clock, MessageNetwork
from poil_drake.systems.lcm.panda_messages import (
    HAND_PERIOD,
    HandOpening,
    PandaChannels,
    PandaStatus,
    encode_hand_command,
    encode_panda_command,
)
from poil_drake.systems.panda.velocity_driver import eval_velocity

_REST = np.zeros(NUM_JOINTS)

_MAX_AGE = 0.1
"""Largest age of a velocity that is sent, by the context's time [s]."""

_GRIP_FORCE = 40.0
"""Force of the grip [N]; the hand can exert 70 N continuously."""


class FrankaCommandSender(LeafSystem):
    """Sends joint velocities to the Panda's driver, which stops the arm when commands cease.

    .. pydrake_system::

        name: FrankaCommandSender
        input_ports:
        - velocity
        - velocity_time

    Drake's `PandaCommandSender` sends whatever its input holds. It stamps commands with the
    context's time, so the driver drops them as expired.

    A publish event sends `velocity` (7,) [rad/s] once per period, stamped with the time by `clock`.
    If `velocity` is not connected or not finite, or was computed more than 0.1 s ago according to
    the optional `velocity_time` (1,) [s], the sender commands a braking motion instead. It sends
    nothing before the first status has arrived, and nothing while `outdated` returns true.
    `SendRest` brings the arm to rest at the end of a run.

    The sender also listens to its own channel: its event raises a StationError once another process
    has commanded the arm.

    Attributes:
        commanding: Whether the sender has sent a command since `SendRest` last brought the arm to
            rest.
        channel: The `SharedChannel` of the commands.
    """

    def __init__(
        self,
        *,
        lcm: MessageNetwork,
        channel: str = PandaChannels.command,
        mailbox: LcmMailbox[PandaStatus],
        limiter: VelocityLimiter,
        period: float = CONTROL_PERIOD,
        offset: float = 0.0,
        expiry: float = 0.1,
        outdated: Callable[[], bool] = lambda: False,
        clock: Clock = time.time,
        time_scale: float = 1.0,
    ):
        """Constructs the sender.

        Args:
            lcm: The network.
            channel: The driver's channel for commands.
            mailbox: Receives the driver's statuses.
            limiter: Plans the braking; its period must be `period`.
            period: Time between two commands [s].
            offset: Time of the first command [s]. With a fraction of the period, each command goes
                out this long after the update that computed it.
            expiry: How long the driver follows a command [s by `clock`].
            outdated: Returns whether the diagram's last update was so long ago that its results
                must not be sent, as after the process was suspended.
            clock: Returns the current time [s since the epoch]; the driver's clock must agree.
            time_scale: Seconds by `clock` per second of real time.
        """
        super().__init__()
        self.commanding, self._sent_at = False, -math.inf
        self.channel = SharedChannel(lcm, channel, what="the robot")
        # The newest first.
        self._sent: deque[np.ndarray] = deque([_REST] * 2, maxlen=2)
        self._mailbox, self._limiter = mailbox, limiter
        self._period, self._time_scale = period, time_scale
        self._expiry, self._clock = expiry, clock
        self._outdated = outdated
        self._velocity = self.DeclareVectorInputPort("velocity", NUM_JOINTS)
        self._velocity_time = self.DeclareVectorInputPort("velocity_time", 1)
        self.DeclarePeriodicPublishEvent(period, offset, self._send)
        self.DeclareForcedPublishEvent(self._send)

    def SendRest(self, duration: float) -> None:
        """Brakes from the last command, then sends zero velocities; blocks until the end.

        The limiter plans the same braking as after a fault, so the arm stays in its allowed space.
        If the last command is so old that the driver has stopped the arm, there is no braking.
        Unix signals such as Ctrl-C take effect only at the end.

        Args:
            duration: How long to send zeros [s], longer than `expiry`.
        """
        with HeldSignals():
            if self._mailbox.newest is None:
                return
            period, start = self._period / self._time_scale, time.monotonic()
            velocities = self._limiter.braking(self._motion())
            elapsed = 0.0
            while elapsed < period * len(velocities) + duration:
                stamp, now = self._clock(), time.monotonic()
                step = int((now - start) / period)
                velocity = velocities[step] if step < len(velocities) else _REST
                self._publish(velocity, stamp, now)
                time.sleep(period)
                elapsed = time.monotonic() - start
            # A process that was suspended meanwhile may not have sent rest yet.
            self.commanding = bool(self._sent[0].any())

    def _send(self, context: Context) -> None:
        self.channel.CheckAlone()
        # Read the clocks first: if the process is suspended from here on, the command carries its
        # true age, and the driver drops it.
        stamp, now = self._clock(), time.monotonic()
        if self._mailbox.newest is None or self._outdated():
            return
        wanted = eval_velocity(context, self._velocity, self._velocity_time, max_age=_MAX_AGE)
        if wanted is None:
            wanted = self._limiter.step(self._motion(), _REST).velocity
        self._publish(wanted, stamp, now)

    def _motion(self) -> JointMotion:
        """Returns the last commanded motion, at position zero; rest if the command has expired.

        The acceleration is the mean over the last period, clipped to the limiter's largest.
        """
        newest, before = self._sent
        followed = self._time_scale * (time.monotonic() - self._sent_at) <= self._expiry
        if not (followed and newest.any()):
            return JointMotion.at_rest(_REST)
        largest = self._limiter.acceleration
        acceleration = (newest - before) / self._period
        return JointMotion(_REST, newest, np.clip(acceleration, -largest, largest))

    def _publish(self, velocity: np.ndarray, stamp: float, now: float) -> None:
        self.commanding, self._sent_at = True, now
        self._sent.appendleft(np.array(velocity))
        self.channel.Send(encode_panda_command(velocity, stamp))


class HandCommandSender(LeafSystem):
    """Sends the desired opening to the Panda's hand.

    .. pydrake_system::

        name: HandCommandSender
        input_ports:
        - width

    The driver accepts the messages of Drake's `SchunkWsgCommandSender`, but that system also
    sends openings that are outdated or not finite.

    A publish event sends `width` (1,) [m] once per period. It sends nothing before the hand's first
    status, while `width` is not connected or not finite, and while `outdated` returns true; the
    hand then keeps its opening. The driver grips when the opening shrinks, and ignores a command
    that repeats the last one.

    The sender also listens to its own channel: its event raises a StationError once another process
    has commanded the hand.

    Attributes:
        channel: The `SharedChannel` of the commands.
    """

    def __init__(
        self,
        *,
        lcm: MessageNetwork,
        channel: str = PandaChannels.hand_command,
        mailbox: LcmMailbox[HandOpening],
        period: float = HAND_PERIOD,
        offset: float = 0.0,
        outdated: Callable[[], bool] = lambda: False,
        clock: Clock = time.time,
    ):
        """Constructs the sender.

        Args:
            lcm: The network.
            channel: The driver's channel for commands.
            mailbox: Receives the hand's statuses.
            period: Time between two commands [s]; the driver reads ten commands a second.
            offset: Time of the first command [s]; if positive, initialization sends nothing.
            outdated: See `FrankaCommandSender`.
            clock: Returns the current time [s since the epoch].
        """
        super().__init__()
        self.channel = SharedChannel(lcm, channel, what="the hand")
        self._mailbox, self._clock, self._outdated = mailbox, clock, outdated
        self._width = self.DeclareVectorInputPort("width", 1)
        self.DeclarePeriodicPublishEvent(period, offset, self._send)
        self.DeclareForcedPublishEvent(self._send)

    def _send(self, context: Context) -> None:
        self.channel.CheckAlone()
        if self._mailbox.newest is None or not self._width.HasValue(context):
            return
        (width,) = self._width.Eval(context).tolist()
        if math.isfinite(width) and not self._outdated():
            opening = HandOpening(stamp=self._clock(), width=width)
            self.channel.Send(encode_hand_command(opening, _GRIP_FORCE))
