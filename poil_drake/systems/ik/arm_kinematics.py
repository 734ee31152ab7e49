"""Forward kinematics and Jacobian of the gripper frame, for systems that know joint positions."""

from collections.abc import Sequence

import numpy as np
from pydrake.common.value import Value
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame, JacobianWrtVariable
from pydrake.systems.framework import CacheEntry, Context, LeafSystem, ValueProducer

from poil_drake.models.panda_model import PANDA_PACKAGE, panda_package_directory
from poil_drake.robots.joint_limits import JointLimits
from poil_drake.robots.panda import ARM_JOINTS, BASE_LINK, GRIPPER_FRAME


class ArmKinematics:
    """The arm's joints and its gripper frame G in a finalized plant.

    The class has no state. Its methods compute in `scratch`, a context of the plant that a system
    keeps in a cache entry (see `declare_scratch`). They use Drake instead of
    `PandaModel`, so that poses equal those of the simulated plant to the last bit.

    Attributes:
        num_joints: The number of the arm's joints, n.
        joint_limits: The limits of the arm's joints.
    """

    def __init__(self, *, plant: MultibodyPlant, frame: Frame, joint_names: Sequence[str]):
        """Finds the arm's joints in the plant.

        Args:
            plant: A finalized plant with the arm at its pose in the world. All other joints stay
                at their default positions.
            frame: The gripper frame G.
            joint_names: The arm's joints in the order of the joint vectors. Each has one degree of
                freedom, and they are consecutive in the plant.
        """
        self._plant = plant
        self._frame = frame
        first = plant.GetJointByName(joint_names[0])
        n = self.num_joints = len(joint_names)
        self._positions = slice(first.position_start(), first.position_start() + n)
        self._velocities = slice(first.velocity_start(), first.velocity_start() + n)
        self._default = plant.GetPositions(plant.CreateDefaultContext())
        self.joint_limits = JointLimits(
            lower=plant.GetPositionLowerLimits()[self._positions],
            upper=plant.GetPositionUpperLimits()[self._positions],
            velocity=plant.GetVelocityUpperLimits()[self._velocities],
            acceleration=plant.GetAccelerationUpperLimits()[self._velocities],
        )

    def declare_scratch(self, system: LeafSystem) -> CacheEntry:
        """Declares the cache entry of `system` that holds a scratch context of the plant."""
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
        """Returns J (6, n) at joint positions (n,) [rad]: V_WG = J qdot, (ω, v) in the world."""
        self._set_positions(scratch, positions)
        world = self._plant.world_frame()
        J = self._plant.CalcJacobianSpatialVelocity(
            scratch, JacobianWrtVariable.kV, self._frame, np.zeros(3), world, world
        )
        return J[:, self._velocities]

    def _set_positions(self, scratch: Context, positions: np.ndarray) -> None:
        all_positions = self._default.copy()
        all_positions[self._positions] = positions
        self._plant.SetPositions(scratch, all_positions)


def MakePandaKinematics(X_WB: RigidTransform | None = None) -> ArmKinematics:
    """Returns the kinematics of the Panda.

    The fingers, which do not move the gripper frame, rest at their default position.

    Args:
        X_WB: Pose of the robot's base; None places it at the world's origin.

    Raises:
        MissingDependencyError: if the Panda's description is not installed.
    """
    # Drake models the coupling of the fingers only in discrete plants.
    plant = MultibodyPlant(time_step=1e-3)
    parser = Parser(plant)
    directory = panda_package_directory()
    parser.package_map().Add(PANDA_PACKAGE, str(directory))
    parser.AddModels(str(directory / "panda.urdf"))
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName(BASE_LINK), X_WB or RigidTransform())
    plant.Finalize()
    return ArmKinematics(
        plant=plant, frame=plant.GetFrameByName(GRIPPER_FRAME), joint_names=ARM_JOINTS
    )
