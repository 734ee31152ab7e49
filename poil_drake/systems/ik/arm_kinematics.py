"""Forward kinematics and Jacobian of the gripper frame, for systems that know joint positions."""

from collections.abc import Sequence

import numpy as np
from pydrake.common.value import Value
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame, JacobianWrtVariable
from pydrake.systems.framework import CacheEntry, Context, LeafSystem, ValueProducer

from poil_drake.errors import StationError
from poil_drake.robots.joint_limits import JointLimits


class ArmKinematics:
    """The arm's joints and its gripper frame G in a finalized plant whose world is ours.

    It holds no state: the plant's context that the methods compute in is scratch, which a system
    keeps in a cache entry of its own context (`declare_scratch`).
    """

    def __init__(self, *, plant: MultibodyPlant, frame: Frame, joint_names: Sequence[str] = ()):
        """Finds the arm's joints in the plant.

        Args:
            plant: A finalized plant with the arm at its place in the world. Any further joints
                stay at their default positions.
            frame: The gripper frame G.
            joint_names: The arm's joints in the order of the joint vectors, each with one degree
                of freedom. Empty: all of the plant's joints that move, in the plant's order.

        Raises:
            StationError: if a named joint does not have exactly one degree of freedom.
        """
        self._plant = plant
        self._frame = frame
        if joint_names:
            joints = [plant.GetJointByName(name) for name in joint_names]
        else:
            joints = [plant.get_joint(index) for index in plant.GetJointIndices()]
            joints = [joint for joint in joints if joint.num_velocities() > 0]
        for joint in joints:
            if joint.num_positions() != 1 or joint.num_velocities() != 1:
                raise StationError(
                    f"Joint '{joint.name()}' has {joint.num_velocities()} degrees of freedom.",
                    remedy="Name the arm's joints in `joint_names`; each must have exactly one.",
                )
        self._positions = _indices([joint.position_start() for joint in joints])
        self._velocities = _indices([joint.velocity_start() for joint in joints])
        self._num_joints = len(joints)
        self._origin = np.zeros(3)
        self._default = plant.GetPositions(plant.CreateDefaultContext())

    @property
    def num_joints(self) -> int:
        """How many joints the arm has."""
        return self._num_joints

    @property
    def position_limits(self) -> tuple[np.ndarray, np.ndarray]:
        """The arm's lower and upper joint limits [rad]."""
        lower, upper = self._plant.GetPositionLowerLimits(), self._plant.GetPositionUpperLimits()
        return lower[self._positions], upper[self._positions]

    @property
    def joint_limits(self) -> JointLimits:
        """All of the arm's joint limits."""
        lower, upper = self.position_limits
        return JointLimits(
            lower=lower,
            upper=upper,
            velocity=self.velocity_limits,
            acceleration=self.acceleration_limits,
        )

    @property
    def velocity_limits(self) -> np.ndarray:
        """The arm's largest joint speeds [rad/s]."""
        return self._plant.GetVelocityUpperLimits()[self._velocities]

    @property
    def acceleration_limits(self) -> np.ndarray:
        """The arm's largest joint accelerations [rad/s^2]."""
        return self._plant.GetAccelerationUpperLimits()[self._velocities]

    def declare_scratch(self, system: LeafSystem) -> CacheEntry:
        """Declares the cache entry of `system` that holds the plant's context."""
        return system.DeclareCacheEntry(
            "scratch context of the arm's plant",
            ValueProducer(
                allocate=Value(self._plant.CreateDefaultContext()).Clone,
                calc=ValueProducer.NoopCalc,
            ),
            {system.nothing_ticket()},
        )

    def pose(self, scratch: Context, positions: np.ndarray) -> np.ndarray:
        """Returns X_WG (4, 4) at joint positions (n,) [rad]."""
        self._set_positions(scratch, positions)
        return self._frame.CalcPoseInWorld(scratch).GetAsMatrix4()

    def jacobian(self, scratch: Context, positions: np.ndarray) -> np.ndarray:
        """Returns J (6, n) with V_WG = J qdot, (ω, v) in the world, at joint positions (n,)."""
        self._set_positions(scratch, positions)
        world = self._plant.world_frame()
        J = self._plant.CalcJacobianSpatialVelocity(
            scratch, JacobianWrtVariable.kV, self._frame, self._origin, world, world
        )
        return J[:, self._velocities]

    def _set_positions(self, scratch: Context, positions: np.ndarray) -> None:
        everything = self._default.copy()
        everything[self._positions] = positions
        self._plant.SetPositions(scratch, everything)


def _indices(indices: list[int]) -> slice | list[int]:
    """Returns the same places as a slice where they are next to each other: no copies are made."""
    first, count = min(indices, default=0), len(indices)
    together = indices == [*range(first, first + count)]
    return slice(first, first + count) if together else indices
