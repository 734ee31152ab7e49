import numpy as np
import pytest
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import SpatialInertia
from pydrake.systems.framework import LeafSystem

from poil_drake.errors import StationError
from poil_drake.systems.ik.arm_kinematics import ArmKinematics


class Holder(LeafSystem):
    """A system with nothing but the arm's scratch."""

    def __init__(self, kinematics: ArmKinematics):
        super().__init__()
        self.scratch = kinematics.declare_scratch(self)


def test_pose_is_that_of_the_hand_calculation(two_joint_arm: ArmKinematics) -> None:
    system = Holder(two_joint_arm)
    scratch = system.scratch.Eval(system.CreateDefaultContext())

    # A quarter turn about z: the links lie along y. Then the second link is turned downwards.
    X_WG = two_joint_arm.pose(scratch, np.array([np.pi / 2, np.pi / 2]))

    np.testing.assert_allclose(X_WG[:3, 3], [0.0, 0.4, -0.3], atol=1e-12)
    np.testing.assert_allclose(X_WG[:3, 0], [0.0, 0.0, -1.0], atol=1e-12)


def test_jacobian_is_that_of_the_hand_calculation(two_joint_arm: ArmKinematics) -> None:
    system = Holder(two_joint_arm)
    scratch = system.scratch.Eval(system.CreateDefaultContext())

    J = two_joint_arm.jacobian(scratch, np.zeros(2))

    np.testing.assert_allclose(J[:, 0], [0.0, 0.0, 1.0, 0.0, 0.7, 0.0], atol=1e-12)
    np.testing.assert_allclose(J[:, 1], [0.0, 1.0, 0.0, 0.0, 0.0, -0.3], atol=1e-12)


def test_limits_are_the_plants(two_joint_arm: ArmKinematics) -> None:
    np.testing.assert_array_equal(two_joint_arm.position_limits, [[-2.0, -2.0], [2.0, 2.0]])
    np.testing.assert_array_equal(two_joint_arm.velocity_limits, [1.0, 1.0])
    np.testing.assert_array_equal(two_joint_arm.acceleration_limits, [8.0, 8.0])


def test_scratch_belongs_to_the_context(two_joint_arm: ArmKinematics) -> None:
    system = Holder(two_joint_arm)
    first, second = system.CreateDefaultContext(), system.CreateDefaultContext()

    assert system.scratch.Eval(first) is not system.scratch.Eval(second)


def test_a_free_body_needs_the_joints_to_be_named() -> None:
    plant = MultibodyPlant(time_step=0.0)
    body = plant.AddRigidBody("free", SpatialInertia.SolidSphereWithMass(mass=1.0, radius=0.1))
    plant.Finalize()

    with pytest.raises(StationError, match="joint_names"):
        ArmKinematics(plant=plant, frame=body.body_frame())
