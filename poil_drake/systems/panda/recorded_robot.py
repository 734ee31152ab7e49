"""Plays back a recorded robot."""

from collections.abc import Collection

import numpy as np
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from poil_drake.recording.run_log.recorded_run import Series
from poil_drake.robots.panda import NUM_JOINTS
from poil_drake.systems.control_period import CONTROL_PERIOD

JOINTS, HAND, STATUS = "joints", "hand", "status"
"""The three kinds of signals, whose recordings may begin at different times."""


class RecordedClock:
    """The recorded clock of a replayed run; its time is constant within a control period.

    Attributes:
        now: The clock's time [s].
    """

    now: float = np.nan

    def __call__(self) -> float:
        """Returns the clock's time [s]."""
        return self.now


class RecordedRobot(LeafSystem):
    """Outputs the recorded signals of an arm and its hand.

    .. pydrake_system::

        name: RecordedRobot
        input_ports:
        - velocity
        - velocity_time
        - width
        output_ports:
        - position_measured
        - velocity_measured
        - torque_external
        - status
        - width_measured
        - position_commanded

    The inputs match those of the other robots, and are ignored. `position_measured` [rad],
    `velocity_measured` [rad/s] and `torque_external` [N m] are (7,), `width_measured` (1,) [m] is
    the hand's opening, and `status` (3,) is that of `FrankaStatusReceiver`. `position_commanded`
    (7,) [rad] is the commanded posture of the recorded run; it cannot be computed from the commands
    of the replay, which the robot does not follow.

    Each output shows the newest sample at or before the context's time, and NaN before the first
    sample. The signals in `leading` show the newest sample at or before the end of the present
    period instead. In the recorded run, an unrestricted update changed these signals before the
    discrete updates read them, but the sample of that time was taken before both updates.
    """

    def __init__(
        self,
        *,
        joints: Series,
        hand: Series,
        status: Series,
        postures: Series,
        period: float = CONTROL_PERIOD,
        clock: RecordedClock | None = None,
        leading: Collection[str] = (JOINTS, HAND, STATUS),
    ):
        """Constructs the robot.

        Args:
            joints: (T, 21) positions [rad], velocities [rad/s] and external torques [N m].
            hand: (T, 1) openings of the hand [m].
            status: (T, 4) values of the port `status`, and the clock's time [s].
            postures: (T, 7) commanded positions [rad].
            period: The control period [s].
            clock: The run's clock, which the robot sets at the beginning of each period.
            leading: Those of `JOINTS`, `HAND` and `STATUS` that an unrestricted update changed in
                the recorded run.
        """
        super().__init__()
        self._period, self._clock, self._status = period, clock, status
        self.DeclareVectorInputPort("velocity", NUM_JOINTS)
        self.DeclareVectorInputPort("velocity_time", 1)
        self.DeclareVectorInputPort("width", 1)
        self._shown = self.DeclareDiscreteState(1)
        if leading or clock is not None:
            self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._step)
        n = NUM_JOINTS
        for name, kind, series, part in (
            ("position_measured", JOINTS, joints, slice(0, n)),
            ("velocity_measured", JOINTS, joints, slice(n, 2 * n)),
            ("torque_external", JOINTS, joints, slice(2 * n, 3 * n)),
            ("status", STATUS, status, slice(0, 3)),
            ("width_measured", HAND, hand, slice(0, 1)),
            ("position_commanded", "", postures, slice(0, n)),
        ):
            self._declare_output(name, series, part, kind in leading)

    def _declare_output(self, name: str, series: Series, part: slice, leads: bool) -> None:
        def calc(context: Context, output: BasicVector) -> None:
            now = context.get_time()
            if leads:
                now = context.get_discrete_state(self._shown)[0]
            output.SetFromVector(series.at(now)[part])

        known = self.discrete_state_ticket(self._shown) if leads else self.time_ticket()
        self.DeclareVectorOutputPort(name, part.stop - part.start, calc, {known})

    def _step(self, context: Context, state: State) -> None:
        time = context.get_time() + self._period
        state.get_mutable_discrete_state(self._shown).SetFromVector(np.array([time]))
        if self._clock is not None:
            self._clock.now = float(self._status.at(time)[3])
