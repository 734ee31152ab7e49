"""Selects the motion of the arm in each phase of the skill."""

import math

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem

from poil_drake.control.field.straight_motion import (
    StraightMotionConfig,
    straight_motion_duration,
    straight_motion_twist,
)
from poil_drake.robots.joint_trajectory import JointTrajectory
from poil_drake.systems.control_period import CONTROL_PERIOD
from poil_drake.systems.skill.phases import TWIST_PHASES, Phase

JOINT_GAIN = 4.0
"""Feedback gain along joint trajectories [1/s]."""

_JOINT_TOLERANCE = 0.02
"""A joint motion is done only if each joint is within this distance of the motion's end [rad]."""


class MotionSource(LeafSystem):
    """Selects a joint motion, a straight motion or the controller's twist for the arm, by phase.

    .. pydrake_system::

        name: MotionSource
        input_ports:
        - phase
        - phase_start
        - position_measured
        - gripper_pose
        - field_velocity
        - ik_velocity
        output_ports:
        - spatial_velocity
        - velocity
        - motion_done

    Inputs: the `Phase` and its start [s], the measured joint positions (7,) [rad], the gripper's
    pose (16,) X_WG row-major, the controller's twist (6,), and the velocities (7,) [rad/s] from the
    inverse kinematics. A twist is (ω [rad/s], v [m/s]) of the gripper in the world. Outputs:

    - `spatial_velocity` (6,): the twist for the inverse kinematics. It is `field_velocity` in
      FOLLOW, a straight motion in LIFT (upwards) and RETREAT (along the gripper's -z axis), and
      zero in other phases.
    - `velocity` (7,) [rad/s], for the safety supervisor: follows a joint trajectory with feedback
      in APPROACH and DESCEND, is `ik_velocity` in phases with a twist, and zero in other phases.
    - `motion_done` (1,): 1 once the duration of the phase's straight or joint motion is over and,
      for a joint motion, the arm has arrived; 0 otherwise.

    A straight motion starts with the first update in its phase, which latches the gripper's pose;
    until then its twist and `motion_done` are zero. A NaN in `ik_velocity` is passed on, so that
    the safety supervisor detects it. A NaN in any other input makes the outputs that are computed
    from it zero.
    """

    def __init__(
        self,
        *,
        approach: JointTrajectory,
        descent: JointTrajectory,
        lift_distance: float = 0.05,
        retreat_distance: float = 0.10,
        straight: StraightMotionConfig | None = None,
        period: float = CONTROL_PERIOD,
    ):
        """Constructs the source.

        Args:
            approach: Motion from the start to the pre-grasp.
            descent: Motion from the pre-grasp to the grasp.
            lift_distance: Height by which the arm lifts the object [m].
            retreat_distance: Distance by which the gripper retreats after release [m].
            straight: Speed and gain of the lift and the retreat.
            period: The control period [s].
        """
        super().__init__()
        self._straight = straight or StraightMotionConfig()
        self._trajectories = {Phase.APPROACH: approach, Phase.DESCEND: descent}
        self._distances = {Phase.LIFT: lift_distance, Phase.RETREAT: retreat_distance}
        n = approach.positions.shape[1]
        phase = self._phase = self.DeclareVectorInputPort("phase", 1)
        start = self._start = self.DeclareVectorInputPort("phase_start", 1)
        joints = self._joints = self.DeclareVectorInputPort("position_measured", n)
        gripper = self._gripper = self.DeclareVectorInputPort("gripper_pose", 16)
        twist = self._field = self.DeclareVectorInputPort("field_velocity", 6)
        ik = self._ik = self.DeclareVectorInputPort("ik_velocity", n)
        # [0]: the phase at whose start the gripper pose was latched; [1:]: that pose, row-major.
        self.DeclareDiscreteState(np.r_[-1.0, np.eye(4).ravel()])
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._latch)
        by_phase = {phase.ticket(), start.ticket(), self.time_ticket()}
        latched = self.xd_ticket()
        self.DeclareVectorOutputPort(
            "spatial_velocity",
            6,
            self._calc_twist,
            by_phase | {latched, gripper.ticket(), twist.ticket()},
        )
        self.DeclareVectorOutputPort(
            "velocity", n, self._calc_velocity, by_phase | {joints.ticket(), ik.ticket()}
        )
        self.DeclareVectorOutputPort(
            "motion_done", 1, self._calc_done, by_phase | {latched, joints.ticket()}
        )

    def _phase_now(self, context: Context) -> Phase:
        """Returns the phase, or WAIT if an input `phase` or `phase_start` is not finite."""
        phase = self._phase.Eval(context)[0]
        known = math.isfinite(phase) and math.isfinite(self._start.Eval(context)[0])
        return Phase(int(phase)) if known else Phase.WAIT

    def _elapsed(self, context: Context) -> float:
        """Returns the time since the phase began [s]."""
        return context.get_time() - float(self._start.Eval(context)[0])

    def _latch(self, context: Context, discrete_state: DiscreteValues) -> None:
        phase = self._phase.Eval(context)[0]
        gripper = self._gripper.Eval(context)
        if context.get_discrete_state_vector()[0] != phase and np.isfinite(gripper).all():
            discrete_state.set_value(np.r_[phase, gripper])

    def _latched(self, context: Context, phase: Phase) -> np.ndarray | None:
        """Returns the gripper's pose (4, 4) latched in this phase; None before it is latched."""
        latched = context.get_discrete_state_vector().value()
        return latched[1:].reshape(4, 4) if latched[0] == phase else None

    def _calc_twist(self, context: Context, output: BasicVector) -> None:
        phase = self._phase_now(context)
        twist = np.zeros(6)
        if phase is Phase.FOLLOW:
            twist = self._field.Eval(context)
        elif phase in self._distances:
            X_WStart = self._latched(context, phase)
            if X_WStart is not None:
                twist = straight_motion_twist(
                    X_WStart,
                    self._gripper.Eval(context).reshape(4, 4),
                    np.array([0.0, 0.0, 1.0]) if phase is Phase.LIFT else -X_WStart[:3, 2],
                    self._distances[phase],
                    self._elapsed(context),
                    self._straight,
                )
        output.SetFromVector(_finite_or_zero(twist))

    def _calc_velocity(self, context: Context, output: BasicVector) -> None:
        phase = self._phase_now(context)
        velocity = np.zeros(output.size())
        if phase in self._trajectories:
            wanted, feedforward = self._trajectories[phase].sample(self._elapsed(context))
            feedback = JOINT_GAIN * (wanted - self._joints.Eval(context))
            velocity = _finite_or_zero(feedforward + feedback)
        elif phase in TWIST_PHASES:
            velocity = self._ik.Eval(context)
        output.SetFromVector(velocity)

    def _calc_done(self, context: Context, output: BasicVector) -> None:
        phase = self._phase_now(context)
        done = False
        if phase in self._trajectories:
            trajectory = self._trajectories[phase]
            distance = np.abs(self._joints.Eval(context) - trajectory.positions[-1])
            arrived = bool(distance.max() <= _JOINT_TOLERANCE)
            done = arrived and self._elapsed(context) >= trajectory.duration
        elif phase in self._distances:
            latched = self._latched(context, phase) is not None
            duration = straight_motion_duration(self._distances[phase], self._straight)
            done = latched and self._elapsed(context) >= duration
        output.SetAtIndex(0, float(done))


def _finite_or_zero(vector: np.ndarray) -> np.ndarray:
    return vector if np.isfinite(vector).all() else np.zeros_like(vector)
