"""The plant of the arm alone, for kinematics."""

from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant

from poil_drake.models.panda_model import (
    ARM_JOINTS,
    GRIPPER_FRAME,
    PANDA_PACKAGE,
    panda_package_directory,
)
from poil_drake.systems.arm_kinematics import ArmKinematics


def MakePandaKinematics() -> ArmKinematics:
    """Returns the kinematics of the Panda whose base is the world's origin.

    The fingers, which do not move the gripper frame, rest at their default position.

    Raises:
        MissingDependencyError: when the Panda's description is not installed.
    """
    # A positive step, because Drake models the fingers' coupling only in discrete plants.
    plant = MultibodyPlant(time_step=1e-3)
    parser = Parser(plant)
    directory = panda_package_directory()
    parser.package_map().Add(PANDA_PACKAGE, str(directory))
    parser.AddModels(str(directory / "panda.urdf"))
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("panda_link0"))
    plant.Finalize()
    return ArmKinematics(
        plant=plant, frame=plant.GetFrameByName(GRIPPER_FRAME), joint_names=ARM_JOINTS
    )
