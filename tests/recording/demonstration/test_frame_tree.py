import numpy as np
from scipy.spatial.transform import Rotation

from poil_drake.recording.demonstration.contents import FrameTree


def pose(x, degrees=0.0):
    X = np.eye(4)
    X[:3, :3] = Rotation.from_euler("z", degrees, degrees=True).as_matrix()
    X[0, 3] = x
    return X


def test_a_chain_is_multiplied_from_the_base():
    dut = FrameTree()
    dut.add(parent="arm", child="camera", stamp=0, X_PC=pose(2.0))
    dut.add(parent="world", child="arm", stamp=0, X_PC=pose(1.0, 90.0))

    X = dut.pose(base="world", frame="camera", stamp=0)

    # The camera is 2 m along the arm's x axis, which points along the world's y axis.
    np.testing.assert_allclose(X, pose(1.0, 90.0) @ pose(2.0), atol=1e-15)
    np.testing.assert_allclose(X[:3, 3], [1.0, 2.0, 0.0], atol=1e-15)
    assert dut.root("camera") == "world"


def test_the_base_may_hang_below_the_frame_or_beside_it():
    dut = FrameTree()
    dut.add(parent="camera", child="tag", stamp=0, X_PC=pose(3.0))
    dut.add(parent="camera", child="other", stamp=0, X_PC=pose(5.0))

    assert dut.pose(base="tag", frame="camera", stamp=0)[0, 3] == -3.0
    assert dut.pose(base="tag", frame="other", stamp=0)[0, 3] == 2.0


def test_a_transform_holds_until_the_next():
    dut = FrameTree()
    for stamp, x in ((20, 2.0), (10, 1.0), (30, 3.0)):
        dut.add(parent="world", child="camera", stamp=stamp, X_PC=pose(x))

    got = [
        dut.pose(base="world", frame="camera", stamp=stamp)[0, 3] for stamp in (0, 10, 19, 20, 99)
    ]

    assert got == [1.0, 1.0, 1.0, 2.0, 3.0]


def test_frames_that_nothing_joins_have_no_pose():
    dut = FrameTree()
    dut.add(parent="world", child="camera", stamp=0, X_PC=pose(1.0))

    assert dut.pose(base="world", frame="mug", stamp=0) is None
    assert "camera" in dut
    assert "world" in dut
    assert "mug" not in dut


def test_a_cycle_does_not_hang():
    dut = FrameTree()
    dut.add(parent="a", child="b", stamp=0, X_PC=pose(1.0))
    dut.add(parent="b", child="a", stamp=0, X_PC=pose(1.0))

    assert dut.pose(base="world", frame="b", stamp=0) is None
