"""The plant of the arm alone, for kinematics."""

from pydrake.math import RigidTransform
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant

from poil_drake.models.panda_model import (
    ARM_JOINTS,
    BASE_LINK,
    GRIPPER_FRAME,
    PANDA_PACKAGE,
    panda_package_directory,
)
from poil_drake.systems.ik.arm_kinematics import ArmKinematics


def MakePandaKinematics(X_WB: RigidTransform | None = None) -> ArmKinematics:
    """Returns the kinematics of the Panda.

    The fingers, which do not move the gripper frame, rest at their default position.

    Args:
        X_WB: Where the robot's base stands; None: at the world's origin.

    Raises:
        MissingDependencyError: when the Panda's description is not installed.
    """
    # A positive step, because Drake models the fingers' coupling only in discrete plants.
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
