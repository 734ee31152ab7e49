import importlib.metadata

import numpy as np
import pytest
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.systems.framework import DiagramBuilder

from poil_drake.errors import MissingDependencyError
from poil_drake.models.panda_model import GRIP_FORCE, panda_package_directory
from poil_drake.robots.panda import ARM_JOINTS, FINGER_JOINTS, GRIPPER_FRAME
from poil_drake.robots.robot_description import panda_description_directory


@pytest.fixture(scope="module")
def plant() -> MultibodyPlant:
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, time_step=0.001)
    Parser(plant).AddModels(str(panda_package_directory() / "panda.urdf"))
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("panda_link0"))
    plant.Finalize()
    plant.diagram = builder.Build()  # keeps the diagram, and so the plant, alive
    return plant


def test_the_arm_and_one_finger_have_actuators(plant: MultibodyPlant) -> None:
    for name in (*ARM_JOINTS, FINGER_JOINTS[0]):
        assert plant.HasJointActuatorNamed(name)
    assert not plant.HasJointActuatorNamed(FINGER_JOINTS[1])
    # 87 N m and 12 N m are the datasheet's; both fingers share the hand's motor.
    np.testing.assert_allclose(plant.GetEffortUpperLimits(), [87] * 4 + [12] * 3 + [2 * GRIP_FORCE])


def test_closed_pads_touch_each_other(plant: MultibodyPlant) -> None:
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, np.zeros(9))
    X_WG = plant.GetFrameByName(GRIPPER_FRAME).CalcPoseInWorld(context)

    for finger in ("panda_leftfinger", "panda_rightfinger"):
        X_WF = plant.GetFrameByName(finger).CalcPoseInWorld(context)
        # The pad's inner face is the plane y = 0 of the finger, and so of the gripper.
        assert X_WG.InvertAndCompose(X_WF).translation()[1] == pytest.approx(0, abs=1e-9)


def test_the_visual_meshes_are_light() -> None:
    directory = panda_package_directory()

    faces = sum(
        line.startswith("f ") for p in directory.glob("*.obj") for line in p.read_text().split("\n")
    )

    assert len(list(directory.glob("*.obj"))) == 10
    assert 5_000 < faces < 25_000


def test_a_missing_description_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    def nowhere(name: str) -> None:
        raise importlib.metadata.PackageNotFoundError(name)

    monkeypatch.setattr(importlib.metadata, "distribution", nowhere)

    with pytest.raises(MissingDependencyError, match="pip install 'example-robot-data"):
        panda_description_directory()
