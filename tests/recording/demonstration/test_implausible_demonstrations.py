"""Depth in another unit, and poses of another frame, in a recording of a table seen from above."""

import numpy as np
import pytest
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage

from poil_drake.errors import DemonstrationError

MILLIMETRES = np.full((24, 32), 600)  # The cameras look down from 0.6 m.
MILLIMETRES[4:20, 6:26] = 500  # A box.


def showing(foreign, pixels: np.ndarray, encoding: str = "16UC1"):
    def depth(i: int, time: float, frame: str) -> RawImage:
        return foreign.raw(encoding, pixels, time, frame)

    foreign.depth = depth


@pytest.mark.parametrize(
    ("pixels", "encoding", "words"),
    [
        (MILLIMETRES.astype("<f4"), "32FC1", "depth is in millimetres, but is read as metres"),
        ((10 * MILLIMETRES).astype("<u2"), "16UC1", "a step of depth is 0.1 mm"),
        # The table is beyond the range of 16 bits, as if there were no depth.
        (np.where(MILLIMETRES < 600, 5000, 65535).astype("<u2"), "16UC1", "a step of depth is 0.1"),
    ],
    ids=["float millimetres", "0.1 mm", "saturated 0.1 mm"],
)
def test_depth_in_another_unit_is_refused_at_load(foreign, pixels, encoding, words):
    showing(foreign, pixels, encoding)

    with pytest.raises(DemonstrationError, match=words) as caught:
        foreign.load()

    assert str(foreign.path) in str(caught.value)
    assert "Camera 'left'" in str(caught.value)


def test_a_unit_that_is_possible_is_refused_where_the_table_is_known(foreign):
    showing(foreign, (4 * MILLIMETRES).astype("<u2"))
    dut = foreign.load()

    with pytest.raises(DemonstrationError, match=r"0\.25 mm, but is read as 1 mm"):
        dut.check_plausible(table_height=0.0)


@pytest.mark.parametrize(
    ("quaternion", "words"),
    [
        # The link's x axis points down, its y axis along the world's -x, and its z axis along y.
        ((-0.5, 0.5, 0.5, 0.5), r"that of a link \(x forward, z up\)"),
        ((0.0, 0.0, 0.0, 1.0), r"OpenGL \(z backward, y up\)"),
    ],
)
def test_the_pose_of_another_frame_is_refused_at_load(foreign, quaternion, words):
    showing(foreign, MILLIMETRES.astype("<u2"))
    q = foreign.transforms[1].rotation
    q.x, q.y, q.z, q.w = quaternion

    with pytest.raises(DemonstrationError, match=f"Camera 'right' .*{words}") as caught:
        foreign.load()

    assert "optical frame" in caught.value.remedy
