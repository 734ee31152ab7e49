import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.systems.framework import LeafSystem

from poil_drake.systems.ik.arm_plant import MakePandaKinematics


@pytest.fixture(scope="module")
def pose_and_limits() -> tuple[np.ndarray, np.ndarray]:
    kinematics = MakePandaKinematics()
    system = LeafSystem()
    scratch = kinematics.declare_scratch(system).Eval(system.CreateDefaultContext())
    return kinematics.pose(scratch, np.zeros(7)), kinematics.acceleration_limits


def test_stretched_out_the_gripper_is_where_the_datasheet_says(
    pose_and_limits: tuple[np.ndarray, np.ndarray],
) -> None:
    # d1 + d3 + d5 - flange - hand above the base, a7 = 0.088 m in front of it, looking down.
    X_WG, _ = pose_and_limits
    height = 0.333 + 0.316 + 0.384 - 0.107 - 0.1034

    np.testing.assert_allclose(X_WG[:3, 3], [0.088, 0.0, height], atol=1e-6)
    np.testing.assert_allclose(X_WG[:3, 2], [0.0, 0.0, -1.0], atol=1e-6)


def test_the_base_carries_the_gripper(pose_and_limits: tuple[np.ndarray, np.ndarray]) -> None:
    X_WB = RigidTransform(RollPitchYaw(0.1, -0.2, 2.0), [0.3, -0.4, 0.5])
    kinematics = MakePandaKinematics(X_WB)
    system = LeafSystem()
    scratch = kinematics.declare_scratch(system).Eval(system.CreateDefaultContext())

    X_WG = kinematics.pose(scratch, np.zeros(7))

    np.testing.assert_allclose(X_WG, X_WB.GetAsMatrix4() @ pose_and_limits[0], atol=1e-12)


def test_acceleration_limits_are_the_datasheets(
    pose_and_limits: tuple[np.ndarray, np.ndarray],
) -> None:
    np.testing.assert_array_equal(pose_and_limits[1], [15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0])
