"""Systems that output the statuses from the drivers of the real Panda and its hand."""

import time

import numpy as np
from pydrake.systems.framework import Context, LeafSystem, State

from poil_drake.robots.panda import NUM_JOINTS
from poil_drake.systems.control_period import CONTROL_PERIOD
from poil_drake.systems.lcm.mailbox import LcmMailbox
from poil_drake.systems.lcm.network import Clock
from poil_drake.systems.lcm.panda_messages import HandOpening, PandaStatus
from poil_drake.systems.statuses import RobotMode

_MAX_HAND_AGE = 0.5
"""Largest age of a valid hand status [s]; the driver sends ten statuses a second."""

_HAND_GRACE = 0.1
"""How long an opening stays valid once its status is too old [s], so that the supervisor detects a
failure of the whole robot first."""


class FrankaStatusReceiver(LeafSystem):
    """Outputs the newest status from the Panda's driver.

    .. pydrake_system::

        name: FrankaStatusReceiver
        output_ports:
        - position_measured
        - velocity_measured
        - torque_external
        - status

    Drake's `PandaStatusReceiver` outputs zeros before the first message, has no port for the robot
    mode or the age of the status, and accepts messages that are late or not finite.

    Every output is state. An unrestricted update takes it from the mailbox once per period, so that
    the discrete updates of the same instant see it. `position_measured` [rad], `velocity_measured`
    [rad/s] and `torque_external` [N m] are (7,), NaN before the first status. `status` (3,) holds
    the `RobotMode`, the age [s] and the share of commands that reach the robot in time. The age is
    the time by `clock` at the last update minus the stamp of the newest status; it is negative if
    the driver's clock is ahead. Before the first status, `status` holds OTHER, infinity and 0. An
    update raises a StationError if two drivers alternate on the channel.
    """

    def __init__(
        self,
        *,
        mailbox: LcmMailbox[PandaStatus],
        period: float = CONTROL_PERIOD,
        clock: Clock = time.time,
    ):
        """Constructs the receiver.

        Args:
            mailbox: Receives the statuses.
            period: Period of the updates [s].
            clock: Returns the current time [s since the epoch].
        """
        super().__init__()
        self._mailbox, self._clock = mailbox, clock
        unknown = np.full(NUM_JOINTS, np.nan)
        for port, value in (
            ("position_measured", unknown),
            ("velocity_measured", unknown),
            ("torque_external", unknown),
            ("status", [float(RobotMode.OTHER), np.inf, 0.0]),
        ):
            self.DeclareStateOutputPort(port, self.DeclareDiscreteState(value))
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._update)

    def _update(self, context: Context, state: State) -> None:
        self._mailbox.CheckOneSender()
        status = self._mailbox.newest
        if status is None:
            return
        age = self._clock() - status.stamp
        discrete_state = state.get_mutable_discrete_state()
        discrete_state.set_value(0, status.position)
        discrete_state.set_value(1, status.velocity)
        discrete_state.set_value(2, status.torque_external)
        discrete_state.set_value(3, [float(status.mode), age, status.success_rate])


class HandStatusReceiver(LeafSystem):
    """Outputs the opening of the Panda's hand.

    .. pydrake_system::

        name: HandStatusReceiver
        output_ports:
        - width_measured

    `width_measured` (1,) [m] is state; an unrestricted update takes it from the mailbox once per
    period. It is NaN before the first status. It becomes NaN again when the stamp of the newest
    status has differed from `clock` by more than 0.5 s for 0.1 s.
    """

    def __init__(
        self,
        *,
        mailbox: LcmMailbox[HandOpening],
        period: float = CONTROL_PERIOD,
        clock: Clock = time.time,
    ):
        """Constructs the receiver.

        Args:
            mailbox: Receives the statuses.
            period: Period of the updates [s].
            clock: Returns the current time [s since the epoch].
        """
        super().__init__()
        self._mailbox, self._clock = mailbox, clock
        self.DeclareStateOutputPort("width_measured", self.DeclareDiscreteState([np.nan]))
        self._valid_at = self.DeclareDiscreteState([-np.inf])
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._update)

    def _update(self, context: Context, state: State) -> None:
        status, time_now = self._mailbox.newest, context.get_time()
        discrete_state = state.get_mutable_discrete_state()
        if status is not None and abs(self._clock() - status.stamp) <= _MAX_HAND_AGE:
            discrete_state.set_value(0, [status.width])
            discrete_state.set_value(self._valid_at, [time_now])
        elif time_now - discrete_state.value(self._valid_at)[0] > _HAND_GRACE:
            discrete_state.set_value(0, [np.nan])
