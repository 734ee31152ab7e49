"""Chooses what moves the arm in each phase."""

import math
from dataclasses import dataclass, field

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem

from poil_drake.control.field.straight_motion import (
    StraightMotionConfig,
    straight_motion_duration,
    straight_motion_twist,
)
from poil_drake.geometry.all_finite import all_finite
from poil_drake.robots.joint_trajectory import JointTrajectory, follow_joint_trajectory
from poil_drake.systems.skill.phases import Phase

# Looking a member up in its class takes longer than the comparison.
_LIFT, _FOLLOW = Phase.LIFT, Phase.FOLLOW
_UP = np.array([0.0, 0.0, 1.0])
_JOINT_PHASES = frozenset({Phase.APPROACH, Phase.DESCEND})
_STRAIGHT_PHASES = frozenset({Phase.LIFT, Phase.RETREAT})
_TWIST_PHASES = frozenset({Phase.LIFT, Phase.FOLLOW, Phase.RETREAT})


@dataclass(frozen=True, kw_only=True)
class MotionSourceConfig:
    """How the open-loop phases move.

    Attributes:
        joint_gain: Feedback gain along joint trajectories [1/s].
        joint_tolerance: How far a joint may be from where its motion ends [rad], for that to have
            ended: an arm that was held up has not arrived.
        lift_distance: How far the object is lifted before the field takes over [m].
        retreat_distance: How far the gripper backs off after release [m].
        straight: Speed and gain of the lift and the retreat.
    """

    joint_gain: float = 4.0
    joint_tolerance: float = 0.02
    lift_distance: float = 0.05
    retreat_distance: float = 0.10
    straight: StraightMotionConfig = field(default_factory=StraightMotionConfig)


class MotionSource(LeafSystem):
    """Sends joint motions, straight motions or the controller's field to the arm, by phase.

    .. pydrake_system::

        name: MotionSource
        input_ports:
        - phase
        - phase_start
        - panda.position_measured
        - gripper_pose
        - field_velocity
        - ik_velocity
        output_ports:
        - spatial_velocity
        - velocity
        - motion_done

    `spatial_velocity` (6,) (ω [rad/s], v [m/s]) of the gripper in the world goes to the inverse
    kinematics: the field while following, a straight twist while lifting (up) and retreating
    (back along the approach axis), zero otherwise. `velocity` (7,) [rad/s] goes to the supervisor:
    the approach and descent trajectories with feedback, else the inverse kinematics' answer in
    `ik_velocity` while there is a twist, else zero. `motion_done` is 1 when the phase's own motion
    has ended, and a joint motion has arrived.

    Before the first update, and whenever an input it needs is NaN, both velocities are zero; with
    an unknown phase or start, or unknown joints in a joint motion, nothing has ended, either. Only
    a NaN of the inverse kinematics goes through: an answer that is none is for the safety
    supervisor to see.
    """

    def __init__(
        self,
        *,
        approach: JointTrajectory,
        descent: JointTrajectory,
        config: MotionSourceConfig,
        period: float,
    ):
        """Constructs the source.

        Args:
            approach: From the start to the pre-grasp.
            descent: From the pre-grasp to the grasp.
            config: Gains and distances.
            period: The control period [s].
        """
        super().__init__()
        self._config = config
        self._trajectory = {Phase.APPROACH: approach, Phase.DESCEND: descent}
        phase = self._phase = self.DeclareVectorInputPort("phase", 1)
        start = self._start = self.DeclareVectorInputPort("phase_start", 1)
        joints = self._joints = self.DeclareVectorInputPort(
            "panda.position_measured", approach.positions.shape[1]
        )
        gripper = self._gripper = self.DeclareVectorInputPort("gripper_pose", 16)
        twist = self._field = self.DeclareVectorInputPort("field_velocity", 6)
        ik = self._ik = self.DeclareVectorInputPort("ik_velocity", approach.positions.shape[1])
        # [0]: the phase for which the gripper pose was latched; [1:]: that pose, row-major.
        state = self.DeclareDiscreteState(np.r_[-1.0, np.eye(4).ravel()])
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._latch)
        latched = self.discrete_state_ticket(state)
        by_phase = {phase.ticket(), start.ticket(), latched, self.time_ticket()}
        self.DeclareVectorOutputPort(
            "spatial_velocity", 6, self._calc_twist, by_phase | {gripper.ticket(), twist.ticket()}
        )
        self.DeclareVectorOutputPort(
            "velocity",
            approach.positions.shape[1],
            self._calc_velocity,
            {phase.ticket(), start.ticket(), self.time_ticket(), joints.ticket(), ik.ticket()},
        )
        self.DeclareVectorOutputPort(
            "motion_done", 1, self._calc_done, by_phase | {joints.ticket()}
        )

    def _phase_now(self, context: Context) -> Phase:
        """Returns the phase; WAIT, in which nothing moves, where it or its start is not known."""
        phase = self._phase.Eval(context)[0]
        known = math.isfinite(phase) and math.isfinite(self._start.Eval(context)[0])
        return Phase(int(phase)) if known else Phase.WAIT

    def _elapsed(self, context: Context) -> float:
        """Returns the time since the phase began [s]."""
        return context.get_time() - float(self._start.Eval(context)[0])

    def _latch(self, context: Context, discrete_state: DiscreteValues) -> None:
        phase = self._phase.Eval(context)[0]
        if context.get_discrete_state_vector()[0] == phase:
            return
        gripper = self._gripper.Eval(context)
        if all_finite(gripper):
            discrete_state.set_value(np.r_[phase, gripper])

    def _latched(self, context: Context, phase: Phase) -> np.ndarray | None:
        """Returns the gripper's pose (4, 4) when the phase began; None before it is known."""
        latched = context.get_discrete_state_vector().value()
        return latched[1:].reshape(4, 4) if latched[0] == phase else None

    def _distance(self, phase: Phase) -> float:
        return self._config.lift_distance if phase is _LIFT else self._config.retreat_distance

    def _straight(self, context: Context, phase: Phase) -> np.ndarray:
        X_WStart = self._latched(context, phase)
        if X_WStart is None:
            return np.zeros(6)
        X_WG = self._gripper.Eval(context).reshape(4, 4)
        return straight_motion_twist(
            X_WStart,
            X_WG,
            _UP if phase is _LIFT else -X_WStart[:3, 2],
            self._distance(phase),
            self._elapsed(context),
            self._config.straight,
        )

    def _calc_twist(self, context: Context, output: BasicVector) -> None:
        phase = self._phase_now(context)
        twist = np.zeros(6)
        if phase is _FOLLOW:
            twist = self._field.Eval(context)
        elif phase in _STRAIGHT_PHASES:
            twist = self._straight(context, phase)
        output.SetFromVector(_finite_or_zero(twist))

    def _calc_velocity(self, context: Context, output: BasicVector) -> None:
        phase = self._phase_now(context)
        velocity = np.zeros(output.size())
        if phase in _JOINT_PHASES:
            velocity = follow_joint_trajectory(
                self._trajectory[phase],
                self._elapsed(context),
                self._joints.Eval(context),
                self._config.joint_gain,
            )
        elif phase in _TWIST_PHASES:
            output.SetFromVector(self._ik.Eval(context))
            return
        output.SetFromVector(_finite_or_zero(velocity))

    def _calc_done(self, context: Context, output: BasicVector) -> None:
        phase = self._phase_now(context)
        done = False
        if phase in _JOINT_PHASES:
            trajectory = self._trajectory[phase]
            off = np.abs(self._joints.Eval(context) - trajectory.positions[-1])
            arrived = bool(off.max() <= self._config.joint_tolerance)
            done = arrived and self._elapsed(context) >= trajectory.duration
        elif phase in _STRAIGHT_PHASES:
            latched = self._latched(context, phase) is not None
            duration = straight_motion_duration(self._distance(phase), self._config.straight)
            done = latched and self._elapsed(context) >= duration
        output.SetAtIndex(0, float(done))


def _finite_or_zero(vector: np.ndarray) -> np.ndarray:
    return vector if all_finite(vector) else np.zeros_like(vector)
