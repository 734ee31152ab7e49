import numpy as np
import pytest
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from scipy.spatial.transform import Rotation

from poil_drake.errors import InvalidValueError
from poil_drake.recording.demonstration.frame_tree import FrameTree
from poil_drake.recording.mcap.message_encoder import MessageEncoder


def pose(x, degrees=0.0):
    X = np.eye(4)
    X[:3, :3] = Rotation.from_euler("z", degrees, degrees=True).as_matrix()
    X[0, 3] = x
    return X


def add(dut, *, parent, child, X_PC, stamp=0, log_time=0, static=False):
    encoded = MessageEncoder().transform(X_PC, parent=parent, child=child, stamp=stamp)
    dut.add(FrameTransform.FromString(encoded.data), log_time=log_time, static=static)


def test_a_chain_is_multiplied_from_the_base():
    dut = FrameTree()
    add(dut, parent="arm", child="camera", X_PC=pose(2.0))
    add(dut, parent="world", child="arm", X_PC=pose(1.0, 90.0))

    X = dut.pose(base="world", frame="camera", stamp=0)

    # The camera is 2 m along the arm's x axis, which points along the world's y axis.
    np.testing.assert_allclose(X, pose(1.0, 90.0) @ pose(2.0), atol=1e-15)
    np.testing.assert_allclose(X[:3, 3], [1.0, 2.0, 0.0], atol=1e-15)
    assert dut.root("camera") == "world"


def test_the_base_may_hang_below_the_frame_or_beside_it():
    dut = FrameTree()
    add(dut, parent="camera", child="tag", X_PC=pose(3.0))
    add(dut, parent="camera", child="other", X_PC=pose(5.0))

    assert dut.pose(base="tag", frame="camera", stamp=0)[0, 3] == -3.0
    assert dut.pose(base="tag", frame="other", stamp=0)[0, 3] == 2.0


SECOND = 1_000_000_000


def moving():
    """Returns a tree whose camera moves by 1 m and turns by 60 degrees a second, at 2 Hz."""
    dut = FrameTree()
    for half in (2, 0, 1):  # In any order.
        add(
            dut,
            parent="world",
            child="camera",
            stamp=SECOND + half * SECOND // 2,
            X_PC=pose(half / 2, 30.0 * half),
        )
    return dut


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.7, 1.0])
def test_a_moving_frame_is_interpolated(share):
    X = moving().pose(base="world", frame="camera", stamp=SECOND + int(share * SECOND))

    np.testing.assert_allclose(X, pose(share, 60.0 * share), atol=1e-12)


def test_beyond_its_transforms_a_moving_frame_keeps_its_last_pose():
    dut = moving()

    assert dut.span(base="world", frame="camera") == (SECOND, 2 * SECOND)
    for stamp, x in ((0, 0.0), (9 * SECOND, 1.0)):
        assert dut.pose(base="world", frame="camera", stamp=stamp)[0, 3] == x


def test_a_gap_in_the_transforms_of_a_moving_frame_is_named():
    dut = moving()
    add(dut, parent="world", child="camera", stamp=5 * SECOND, X_PC=pose(4.0))

    with pytest.raises(
        InvalidValueError, match=r"'camera' moves.* 2\.000 s and 5\.000 s.* 3\.00 s"
    ):
        dut.pose(base="world", frame="camera", stamp=3 * SECOND)


@pytest.mark.parametrize("static", [True, False])
def test_a_frame_at_rest_holds_for_ever(static):
    dut = FrameTree()
    for stamp in (0, SECOND, 90 * SECOND):
        X = pose(1.0 if not static or stamp else 7.0)
        add(dut, parent="world", child="camera", stamp=stamp, X_PC=X, static=static)

    first, last = dut.span(base="world", frame="camera")

    assert first < 0
    assert last > 1e9 * SECOND
    for stamp in (0, 40 * SECOND, 1_000 * SECOND):
        assert dut.pose(base="world", frame="camera", stamp=stamp)[0, 3] == 1.0


@pytest.mark.parametrize("stamp", [0, 77])
def test_transforms_with_one_stamp_count_from_their_logging(stamp):
    dut = FrameTree()
    for second in (1, 2):
        add(
            dut,
            parent="world",
            child="camera",
            stamp=stamp,
            log_time=second * SECOND,
            X_PC=pose(float(second)),
        )

    assert dut.pose(base="world", frame="camera", stamp=3 * SECOND // 2)[0, 3] == 1.5


def test_a_frame_on_a_moving_frame_moves_with_it():
    dut = moving()
    add(dut, parent="camera", child="lens", X_PC=pose(0.1))

    X = dut.pose(base="world", frame="lens", stamp=SECOND + SECOND // 4)

    np.testing.assert_allclose(X, pose(0.25, 15.0) @ pose(0.1), atol=1e-12)
    assert dut.span(base="lens", frame="world") == (SECOND, 2 * SECOND)


def test_the_motion_of_a_common_ancestor_does_not_count():
    # As with a robot on a mobile base that is localized every 9 s.
    dut = FrameTree()
    for second in (4, 13):
        add(dut, parent="map", child="world", stamp=second * SECOND, X_PC=pose(float(second)))
    add(dut, parent="world", child="arm", X_PC=pose(1.0, 90.0))
    add(dut, parent="arm", child="camera", X_PC=pose(2.0))

    first, last = dut.span(base="world", frame="camera")
    X = dut.pose(base="world", frame="camera", stamp=7 * SECOND)

    assert first < 0 < 90 * SECOND < last
    np.testing.assert_allclose(X, pose(1.0, 90.0) @ pose(2.0), atol=1e-15)


def test_frames_that_nothing_joins_have_no_pose():
    dut = FrameTree()
    add(dut, parent="world", child="camera", X_PC=pose(1.0))

    assert not dut.connected(base="world", frame="mug")
    with pytest.raises(InvalidValueError, match="no transform connects frame 'world' with"):
        dut.pose(base="world", frame="mug", stamp=0)
    assert "camera" in dut
    assert "world" in dut
    assert "mug" not in dut
    assert not dut.connected(base="", frame="")


def test_a_cycle_does_not_hang():
    dut = FrameTree()
    add(dut, parent="a", child="b", X_PC=pose(1.0))
    add(dut, parent="b", child="a", X_PC=pose(1.0))

    assert not dut.connected(base="world", frame="b")
