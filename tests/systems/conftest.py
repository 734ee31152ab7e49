"""Toy arms built in code, whose kinematics can be written down by hand; shared benches."""

import numpy as np
import pytest
from panda_bench import RobotBench, make_arm_bench, make_hand_bench
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    FixedOffsetFrame,
    PrismaticJoint,
    RevoluteJoint,
    SpatialInertia,
)

from poil_drake.systems.ik.arm_kinematics import ArmKinematics

X_AXIS, Y_AXIS, Z_AXIS = np.eye(3)


def make_arm(joints: list[tuple[type, np.ndarray, float]], *, tip: float) -> ArmKinematics:
    """Returns a chain of (joint type, axis, length of the link before it along x)."""
    plant = MultibodyPlant(time_step=0.0)
    parent = plant.world_frame()
    for number, (joint_type, axis, length) in enumerate(joints):
        link = plant.AddRigidBody(
            f"link{number}", SpatialInertia.SolidSphereWithMass(mass=1.0, radius=0.1)
        )
        base = plant.AddFrame(
            FixedOffsetFrame(f"base{number}", parent, RigidTransform([length, 0.0, 0.0]))
        )
        joint = plant.AddJoint(
            joint_type(
                f"joint{number}",
                base,
                link.body_frame(),
                axis,
                pos_lower_limit=-2.0,
                pos_upper_limit=2.0,
            )
        )
        joint.set_velocity_limits([-1.0], [1.0])
        joint.set_acceleration_limits([-8.0], [8.0])
        parent = link.body_frame()
    frame = plant.AddFrame(FixedOffsetFrame("tip", parent, RigidTransform([tip, 0.0, 0.0])))
    plant.Finalize()
    names = [f"joint{number}" for number in range(len(joints))]
    return ArmKinematics(plant=plant, frame=frame, joint_names=names)


@pytest.fixture
def two_joint_arm() -> ArmKinematics:
    """A turn about z at the origin, then 0.4 m along x a turn about y, then 0.3 m to the tip."""
    return make_arm([(RevoluteJoint, Z_AXIS, 0.0), (RevoluteJoint, Y_AXIS, 0.4)], tip=0.3)


@pytest.fixture
def gantry() -> ArmKinematics:
    """Slides along x, y, z, turns about x, y, z at the tip, and slides along x first of all.

    At zero turns its Jacobian is a permutation, with the two slides along x sharing one row.
    """
    slides = [(PrismaticJoint, axis, 0.0) for axis in (X_AXIS, X_AXIS, Y_AXIS, Z_AXIS)]
    turns = [(RevoluteJoint, axis, 0.0) for axis in (X_AXIS, Y_AXIS, Z_AXIS)]
    return make_arm([*slides, *turns], tip=0.0)


@pytest.fixture
def arm() -> RobotBench:
    return make_arm_bench()


@pytest.fixture
def hand() -> RobotBench:
    return make_hand_bench()
