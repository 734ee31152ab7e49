import numpy as np
import pinocchio
from numpy.testing import assert_allclose
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant

from poil_drake.geometry.rigid_transform import make_transform, rotation_exp
from poil_drake.models.panda_model import panda_package_directory
from poil_drake.robots.panda import GRIPPER_FRAME, NOMINAL_POSTURE
from poil_drake.robots.panda_kinematics import PandaModel
from poil_drake.robots.robot_description import panda_urdf


def random_configurations(model: PandaModel, count: int) -> np.ndarray:
    return np.random.default_rng(3).uniform(model.lower, model.upper, (count, 7))


def test_gripper_pose_is_that_of_drake(model: PandaModel):
    plant = MultibodyPlant(0.0)
    Parser(plant).AddModels(str(panda_package_directory() / "panda.urdf"))
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("panda_link0"))
    plant.Finalize()
    context = plant.CreateDefaultContext()
    frame = plant.GetFrameByName(GRIPPER_FRAME)
    configurations = random_configurations(model, 5)

    poses = model.gripper_pose(configurations)

    for q, X_WG in zip(configurations, poses, strict=True):
        plant.SetPositions(context, np.concatenate([q, [0.0, 0.0]]))
        assert_allclose(X_WG, frame.CalcPoseInWorld(context).GetAsMatrix4(), atol=1e-12)


def test_jacobian_is_that_of_pinocchio(model: PandaModel):
    full = pinocchio.buildModelFromUrdf(str(panda_urdf()))
    data = full.createData()
    frame = full.getFrameId(GRIPPER_FRAME)
    configurations = random_configurations(model, 5)

    _, jacobians = model.gripper_pose_and_jacobian(configurations)

    for q, jacobian in zip(configurations, jacobians, strict=True):
        whole = pinocchio.computeFrameJacobian(
            full, data, np.concatenate([q, [0.0, 0.0]]), frame, pinocchio.LOCAL_WORLD_ALIGNED
        )
        # Pinocchio puts the linear velocity first.
        assert_allclose(jacobian, np.vstack([whole[3:, :7], whole[:3, :7]]), atol=1e-12)


def test_the_base_carries_every_link(model: PandaModel):
    X_WB = make_transform(rotation_exp([0.1, -0.2, 2.0]), [0.3, -0.4, 0.5])
    configurations = random_configurations(model, 3)

    moved = PandaModel(X_WB=X_WB)

    assert_allclose(
        moved.link_poses(configurations), X_WB @ model.link_poses(configurations), atol=1e-12
    )


def test_nominal_posture_points_the_gripper_down(model: PandaModel):
    assert_allclose(model.gripper_pose(NOMINAL_POSTURE)[:3, 2], [0.0, 0.0, -1.0], atol=1e-9)


def test_limit_margin_is_the_distance_to_the_nearest_limit(model: PandaModel):
    q = np.array(NOMINAL_POSTURE)
    q[3] = model.lower[3] + 0.1

    assert_allclose(model.limit_margin(q), 0.1)
    q[6] = model.upper[6] + 0.2
    assert_allclose(model.limit_margin(q), -0.2)
