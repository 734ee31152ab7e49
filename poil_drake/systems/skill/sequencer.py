"""The system that runs the skill's state machine."""

import math
from functools import partial

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem

from poil_drake.runtime.stopwatch import Stopwatch
from poil_drake.systems.control_period import CONTROL_PERIOD
from poil_drake.systems.safety.faults import SafetyFault
from poil_drake.systems.skill.phases import Phase
from poil_drake.systems.skill.state_machine import (
    Observation,
    SkillConfig,
    SkillState,
    next_state,
)
from poil_drake.systems.statuses import ControllerStatus, IkStatus, TrackerStatus

_INPUTS = (
    "tracker_status",
    "controller_status",
    "tau",
    "mean_error",
    "goal_error",
    "motion_done",
    "ik_status",
    "width_measured",
    "safety_fault",
)
_OUTPUTS = ("phase", "phase_start", "fault", "width", "holding", "detect_request")


class SkillSequencer(LeafSystem):
    """Runs the skill's state machine: waits, grasps, moves the object to its goal and retreats.

    .. pydrake_system::

        name: SkillSequencer
        input_ports:
        - tracker_status
        - controller_status
        - tau
        - mean_error
        - goal_error
        - motion_done
        - ik_status
        - width_measured
        - safety_fault
        output_ports:
        - phase
        - phase_start
        - fault
        - width
        - holding
        - detect_request

    Every port has size 1. The statuses are a `TrackerStatus`, a `ControllerStatus` and an
    `IkStatus`. The sequencer reads the controller's outputs `controller_status`, `tau` [s],
    `mean_error` [m] and `goal_error` [m] only in the phase FOLLOW; NaN counts as no progress.
    `motion_done` is 1 once the phase's motion has ended. A NaN in the hand's `width_measured` [m]
    is a fault, and so is a `safety_fault` other than `SafetyFault.NONE`.

    Every output is a function of the state alone. `phase` is a `Phase` that began at `phase_start`
    [s], and `fault` is a `Fault`, both of `poil_drake.systems.skill.phases`. `width` [m] is the
    commanded opening of the hand, which a fault leaves unchanged; `holding` is 1 while the object
    moves with the gripper; `detect_request` counts requests for a new search by the
    part detector. Before the first update the phase is WAIT, the hand opens, and `holding` and
    `detect_request` are 0.
    """

    def __init__(
        self,
        *,
        config: SkillConfig | None = None,
        period: float = CONTROL_PERIOD,
        stopwatch: Stopwatch | None = None,
    ):
        """Constructs the sequencer.

        Args:
            config: Thresholds and times of the skill.
            period: The control period [s].
            stopwatch: Records the durations of the updates as "control".
        """
        super().__init__()
        self._stopwatch = stopwatch or Stopwatch()
        self._config = config or SkillConfig()
        self._inputs = {name: self.DeclareVectorInputPort(name, 1) for name in _INPUTS}
        self.DeclareDiscreteState(np.array(SkillState(width=self._config.open_width)))
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._update)
        for name in _OUTPUTS:
            self.DeclareVectorOutputPort(name, 1, partial(self._calc, name), {self.xd_ticket()})

    def skill_state(self, context: Context) -> SkillState:
        """Returns the sequencer's memory in the system's `context`."""
        return SkillState(*context.get_discrete_state_vector().value().tolist())

    def _calc(self, name: str, context: Context, output: BasicVector) -> None:
        output.SetAtIndex(0, getattr(self.skill_state(context), name))

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        with self._stopwatch.measure("control"):
            state = self.skill_state(context)
            observation = self._observe(context, following=state.phase == Phase.FOLLOW)
            discrete_state.set_value(np.array(next_state(state, observation, self._config)))

    def _observe(self, context: Context, *, following: bool) -> Observation:
        def value(name: str) -> float:
            return float(self._inputs[name].Eval(context)[0])

        def controller(name: str) -> float:
            # Evaluating these inputs computes the field, which only FOLLOW needs.
            return value(name) if following else math.nan

        status = controller("controller_status")
        return Observation(
            time=context.get_time(),
            tracking=value("tracker_status") == TrackerStatus.TRACKING,
            at_goal=status == ControllerStatus.GOAL,
            points_lost=status == ControllerStatus.LOST,
            tau=controller("tau"),
            mean_error=controller("mean_error"),
            goal_error=controller("goal_error"),
            motion_done=value("motion_done") > 0.5,
            ik_stuck=value("ik_status") == IkStatus.STUCK,
            hand_width=value("width_measured"),
            safe=value("safety_fault") == SafetyFault.NONE,
        )
