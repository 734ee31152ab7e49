import numpy as np
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.systems.framework import LeafSystem

from poil_drake.systems.ik.arm_kinematics import ArmKinematics, MakePandaKinematics


class Holder(LeafSystem):
    """A system with nothing but the arm's scratch context."""

    def __init__(self, kinematics: ArmKinematics):
        super().__init__()
        self.entry = kinematics.declare_scratch(self)
        self.context = self.CreateDefaultContext()
        self.scratch = self.entry.Eval(self.context)


def test_pose_is_that_of_the_hand_calculation(two_joint_arm: ArmKinematics) -> None:
    system = Holder(two_joint_arm)

    # A quarter turn about z: the links lie along y. Then the second link is turned downwards.
    X_WG = two_joint_arm.pose(system.scratch, np.array([np.pi / 2, np.pi / 2]))

    np.testing.assert_allclose(X_WG[:3, 3], [0.0, 0.4, -0.3], atol=1e-12)
    np.testing.assert_allclose(X_WG[:3, 0], [0.0, 0.0, -1.0], atol=1e-12)


def test_jacobian_is_that_of_the_hand_calculation(two_joint_arm: ArmKinematics) -> None:
    J = two_joint_arm.jacobian(Holder(two_joint_arm).scratch, np.zeros(2))

    np.testing.assert_allclose(J[:, 0], [0.0, 0.0, 1.0, 0.0, 0.7, 0.0], atol=1e-12)
    np.testing.assert_allclose(J[:, 1], [0.0, 1.0, 0.0, 0.0, 0.0, -0.3], atol=1e-12)


def test_limits_are_the_plants(two_joint_arm: ArmKinematics) -> None:
    limits = two_joint_arm.joint_limits

    np.testing.assert_array_equal([limits.lower, limits.upper], [[-2.0, -2.0], [2.0, 2.0]])
    np.testing.assert_array_equal(limits.velocity, [1.0, 1.0])
    np.testing.assert_array_equal(limits.acceleration, [8.0, 8.0])


def test_scratch_belongs_to_the_context(two_joint_arm: ArmKinematics) -> None:
    system = Holder(two_joint_arm)

    assert system.entry.Eval(system.CreateDefaultContext()) is not system.scratch


def test_the_stretched_panda_reaches_where_the_datasheet_says() -> None:
    kinematics = MakePandaKinematics()
    system = Holder(kinematics)

    X_WG = kinematics.pose(system.scratch, np.zeros(7))

    # d1 + d3 + d5 - flange - hand above the base, a7 = 0.088 m in front of it, looking down.
    height = 0.333 + 0.316 + 0.384 - 0.107 - 0.1034
    np.testing.assert_allclose(X_WG[:3, 3], [0.088, 0.0, height], atol=1e-6)
    np.testing.assert_allclose(X_WG[:3, 2], [0.0, 0.0, -1.0], atol=1e-6)
    accelerations = [15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0]
    np.testing.assert_array_equal(kinematics.joint_limits.acceleration, accelerations)

    X_WB = RigidTransform(RollPitchYaw(0.1, -0.2, 2.0), [0.3, -0.4, 0.5])
    moved = MakePandaKinematics(X_WB)
    X_WG_moved = moved.pose(Holder(moved).scratch, np.zeros(7))
    np.testing.assert_allclose(X_WG_moved, X_WB.GetAsMatrix4() @ X_WG, atol=1e-12)
