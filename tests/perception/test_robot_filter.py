import numpy as np
import pytest
from box_scene import box, picture

from poil_drake.perception.robot_filter import without_robot
from poil_drake.robots.panda_kinematics import PandaModel
from poil_drake.robots.panda_spheres import GRIPPER_LINK

PALM = np.array([0.0, 0.0, -0.08, 1.0])
"""A point of the hand in the frame between the finger tips."""

Q = np.array([0.0, -0.9, 0.0, -2.5, 0.0, 1.6, 0.785398])


@pytest.fixture(scope="module")
def seen(model: PandaModel):
    """The cameras see something at the palm, something 20 cm below it, and the table."""
    at = (model.link_poses(Q)[GRIPPER_LINK] @ PALM)[:3]
    X_WB = np.eye(4)
    X_WB[:3, 3] = [0.0, 0.0, 0.25] - at
    palm, below = box([0.0, 0.0, 0.25], [0.02] * 3), box([0.0, 0.0, 0.05], [0.02] * 3)
    return PandaModel(X_WB=X_WB), picture({"palm": (palm,), "below": (below,)})


@pytest.mark.parametrize("opening", [0.05, np.nan], ids=["known", "unknown"])
def test_only_what_is_at_the_robot_loses_its_depth(seen, opening: float) -> None:
    model, views = seen

    dut = without_robot(views.frame, model, Q, opening)

    for k, (before, after) in enumerate(zip(views.frame.images, dut.images, strict=True)):
        gone = after.depth != before.depth
        assert views.masks["palm"][k].sum() > 500
        assert (after.depth[gone] == 0.0).all()
        assert gone[views.masks["palm"][k]].all()
        assert not gone[views.masks["below"][k]].any()
        np.testing.assert_array_equal(after.rgb, before.rgb)


def test_a_robot_elsewhere_leaves_the_views_as_they_are(seen) -> None:
    X_WB = np.eye(4)
    X_WB[0, 3] = -3.0

    dut = without_robot(seen[1].frame, PandaModel(X_WB=X_WB), Q, 0.0)

    for before, after in zip(seen[1].frame.images, dut.images, strict=True):
        np.testing.assert_array_equal(after.depth, before.depth)
