"""Moves an object along a commanded twist without an arm, like a hand of limited strength."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from pydrake.common.value import AbstractValue, Value
from pydrake.math import RigidTransform
from pydrake.multibody.math import SpatialForce, SpatialVelocity
from pydrake.multibody.plant import ExternallyAppliedSpatialForce, MultibodyPlant
from pydrake.multibody.tree import RigidBody
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from poil_drake.control.field.twist_fit import shift_twist
from poil_drake.geometry.rigid_transform import inverse, make_transform, rotation_exp


@dataclass(frozen=True, kw_only=True)
class ActuationConfig:
    """Strength and stiffness of the hand.

    Attributes:
        gain: Rate at which the object's velocity approaches the commanded one [1/s]. With a time
            step of 1/128 s, it must stay well below 128 / s.
        max_force: Largest force [N], without the force that carries the weight.
        max_torque: Largest torque [N m].
    """

    gain: float = 60.0
    max_force: float = 5.0
    max_torque: float = 0.3


class Slip(NamedTuple):
    """How an object slips in the hand: at constant speed, over a short time.

    Attributes:
        start: When the slip begins [s]; infinity for never.
        duration: Its duration [s].
        shift: (3,) total shift of the object relative to the hand [m, hand frame].
        turn: (3,) total rotation vector of the object relative to the hand [rad, hand frame].
    """

    start: float
    duration: float
    shift: np.ndarray
    turn: np.ndarray

    def share(self, time: float) -> float:
        """Returns the share of the slip that has happened by a time [s], in [0, 1]."""
        return float(np.clip((time - self.start) / self.duration, 0.0, 1.0))


NO_SLIP = Slip(np.inf, 1.0, np.zeros(3), np.zeros(3))


def servo_wrench(
    commanded: np.ndarray,
    measured: np.ndarray,
    mass: float,
    inertia: np.ndarray,
    c: ActuationConfig,
) -> np.ndarray:
    """Returns a bounded wrench (6,) [N m, N] that drives a measured velocity to the commanded one.

    Args:
        commanded: (6,) commanded (omega [rad/s], v [m/s]) of the centre of mass, world.
        measured: (6,) measured (omega [rad/s], v [m/s]) of the centre of mass, world.
        mass: Mass [kg].
        inertia: (3, 3) rotational inertia about the centre of mass [kg m^2, world].
        c: Gain and limits. A torque or force beyond its limit is scaled down to it.
    """
    acceleration = c.gain * (commanded - measured)
    torque, force = inertia @ acceleration[:3], mass * acceleration[3:]
    torque *= min(1.0, c.max_torque / max(math.hypot(*torque), 1e-12))
    force *= min(1.0, c.max_force / max(math.hypot(*force), 1e-12))
    return np.concatenate([torque, force])


class DirectActuation(LeafSystem):
    """Moves a body with a bounded wrench, so that obstacles stop it.

    .. pydrake_system::

        name: DirectActuation
        input_ports:
        - twist
        - point
        - body_poses
        - body_spatial_velocities
        output_ports:
        - applied_spatial_force
        - hand_pose

    Inputs: `twist` (6,), (omega [rad/s], v [m/s]) of `point` (3,) [m, world], and the plant's
    `body_poses` and `body_spatial_velocities`. Outputs, both functions of the inputs and time:

    - `applied_spatial_force`: a list with one spatial force at the object's centre of mass, the sum
      of `servo_wrench` and the force that carries the weight.
    - `hand_pose` (16,): X_WH row-major of the hand, a frame that coincides with the driven body
      until the object slips.

    Abstract parameter 0 is a `Slip`, `NO_SLIP` by default.

    Args:
        plant: The finalized plant.
        body: The driven body. The mass and inertia are those of its whole model instance.
        config: Strength and stiffness.
    """

    def __init__(self, *, plant: MultibodyPlant, body: RigidBody, config: ActuationConfig):
        super().__init__()
        self._config = config
        self._body = body.index()
        context = plant.CreateDefaultContext()
        bodies = plant.GetBodyIndices(body.model_instance())
        inertia = plant.CalcSpatialInertia(context, body.body_frame(), bodies)
        self._mass = inertia.get_mass()
        self._center = inertia.get_com()
        self._inertia = inertia.Shift(self._center).CalcRotationalInertia().CopyToFullMatrix3()
        self._weight = self._mass * 9.81 if plant.is_gravity_enabled(body.model_instance()) else 0.0
        self._twist = self.DeclareVectorInputPort("twist", 6)
        self._point = self.DeclareVectorInputPort("point", 3)
        n = plant.num_bodies()
        self._poses = self.DeclareAbstractInputPort("body_poses", Value([RigidTransform()] * n))
        self._velocities = self.DeclareAbstractInputPort(
            "body_spatial_velocities", Value([SpatialVelocity()] * n)
        )
        self._slip = self.DeclareAbstractParameter(Value(NO_SLIP))
        always = {self.time_ticket(), self._poses.ticket(), self.all_parameters_ticket()}
        self.DeclareAbstractOutputPort(
            "applied_spatial_force",
            lambda: AbstractValue.Make([ExternallyAppliedSpatialForce()]),
            self._calc_force,
            always | {p.ticket() for p in (self._twist, self._point, self._velocities)},
        )
        self.DeclareVectorOutputPort("hand_pose", 16, self._calc_hand, always)

    def SetSlip(self, context: Context, slip: Slip) -> None:
        """Sets the `Slip` in this system's context."""
        context.get_mutable_abstract_parameter(self._slip).set_value(slip)

    def _get_slip(self, context: Context) -> Slip:
        return context.get_abstract_parameter(self._slip).get_value()

    def _calc_force(self, context: Context, output: AbstractValue) -> None:
        X_WB = self._poses.Eval(context)[self._body]
        velocity = self._velocities.Eval(context)[self._body]
        R = X_WB.rotation().matrix()
        p_BoCo = R @ self._center
        measured = velocity.Shift(p_BoCo).get_coeffs()
        twist, point = self._twist.Eval(context), self._point.Eval(context)
        commanded = shift_twist(twist, X_WB.translation() + p_BoCo - point)
        commanded += self._slip_velocity(context, R, p_BoCo)
        inertia = R @ self._inertia @ R.T
        wrench = servo_wrench(commanded, measured, self._mass, inertia, self._config)
        wrench[5] += self._weight
        applied = ExternallyAppliedSpatialForce()
        applied.body_index = self._body
        applied.p_BoBq_B = self._center
        applied.F_Bq_W = SpatialForce(tau=wrench[:3], f=wrench[3:])
        output.set_value([applied])

    def _slip_velocity(self, context: Context, R: np.ndarray, p_BoCo: np.ndarray) -> np.ndarray:
        """Returns the velocity (6,) of the object's centre of mass Co relative to the hand, world.

        In a slip, X_HO = (exp(s turn), s shift), where s is `Slip.share`. R is R_WO, and p_BoCo is
        in world axes.
        """
        slip, time = self._get_slip(context), context.get_time()
        if not slip.start <= time < slip.start + slip.duration:
            return np.zeros(6)
        R_WH = R @ rotation_exp(-slip.share(time) * slip.turn)
        omega, v = R_WH @ slip.turn / slip.duration, R_WH @ slip.shift / slip.duration
        return np.concatenate([omega, v + np.cross(omega, p_BoCo)])

    def _calc_hand(self, context: Context, output: BasicVector) -> None:
        slip = self._get_slip(context)
        share = slip.share(context.get_time())
        X_WB = self._poses.Eval(context)[self._body].GetAsMatrix4()
        if share > 0.0:
            X_HO = make_transform(rotation_exp(share * slip.turn), share * slip.shift)
            X_WB = X_WB @ inverse(X_HO)
        output.SetFromVector(X_WB.ravel())
