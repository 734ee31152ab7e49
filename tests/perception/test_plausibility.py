"""Units of depth and conventions of poses, judged by rendered views of a table with a box."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from poil_drake.errors import CaptureError
from poil_drake.perception.images import CameraModel, MultiViewFrame, RgbdImage
from poil_drake.perception.plausibility import check_plausible

SIZE = (48, 64)
K = np.array([[55.0, 0.0, 31.5], [0.0, 55.0, 23.5], [0.0, 0.0, 1.0]])
# The axes (columns) of a link, x forward and z up, and of OpenGL's camera, z backward and y up.
LINK_IN_OPTICAL = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
OPENGL_IN_OPTICAL = np.diag([1.0, -1.0, -1.0])


def camera_pose(elevation, position):
    """Returns X_WC of a camera that looks along the world's x axis, `elevation` [deg] up."""
    X = np.eye(4)
    level = np.column_stack([[0, -1, 0], [0, 0, -1], [1, 0, 0]])
    X[:3, :3] = Rotation.from_euler("y", -elevation, degrees=True).as_matrix() @ level
    X[:3, 3] = position
    return X


def view(elevation=-40.0, position=(0.0, 0.0, 0.6), *, table=0.0, wall=3.0):
    """Returns the true camera, and its depth of a table 1.2 m deep, a floor and a wall."""
    X_WC = camera_pose(elevation, np.add(position, [0.0, 0.0, table]))
    v, u = np.mgrid[: SIZE[0], : SIZE[1]]
    rays = np.stack([u, v, np.ones(SIZE)], axis=-1) @ np.linalg.inv(K).T @ X_WC[:3, :3].T
    depth = (wall - X_WC[0, 3]) / np.maximum(rays[..., 0], 1e-9)
    floor, on_table = ((h - X_WC[2, 3]) / np.minimum(rays[..., 2], -1e-9) for h in (-0.75, table))
    depth = np.minimum(depth, np.where(rays[..., 2] < 0.0, floor, np.inf))
    x = X_WC[0, 3] + on_table * rays[..., 0]
    depth = np.where((rays[..., 2] < 0.0) & (x < 1.2), np.minimum(depth, on_table), depth)
    depth[20:28, 28:36] *= 0.9  # A box.
    return X_WC, np.where(depth < 9.0, depth, 0.0)


def frame(*views, names=("left", "right")):
    cameras, images = [], []
    for name, (X_WC, depth) in zip(names, views, strict=False):
        cameras.append(CameraModel(name, SIZE[1], SIZE[0], K, X_WC))
        images.append(RgbdImage(np.zeros((*SIZE, 3), np.uint8), depth.astype(np.float32), 0.0))
    return MultiViewFrame(tuple(cameras), tuple(images))


def given(X_WC, R):
    X = X_WC.copy()
    X[:3, :3] = X_WC[:3, :3] @ R
    return X


@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize("table", [0.0, 0.75, -0.3])
@pytest.mark.parametrize("elevation", [-90.0, -60.0, -30.0, -12.0])
def test_true_views_are_plausible(known, table, elevation):
    dut = frame(view(elevation, table=table), view(-50.0, (0.2, 0.1, 1.1), table=table))

    check_plausible(dut, table_height=table if known else None)


def test_a_floor_far_below_a_table_that_is_seen_does_not_tell_the_unit():
    # At a quarter of its depth, the floor would be as high as the table.
    check_plausible(frame(view(-17.0, (0.8, 0.0, 0.3), wall=9.0)), table_height=0.0)


def test_a_camera_that_looks_up_is_plausible_if_nothing_else_is_likelier():
    X_WC, _ = view(25.0)
    rng = np.random.default_rng(0)

    check_plausible(frame((X_WC, rng.uniform(0.5, 2.0, SIZE))))


@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize(
    ("R", "cause"), [(LINK_IN_OPTICAL, "x forward"), (OPENGL_IN_OPTICAL, "OpenGL")]
)
@pytest.mark.parametrize("elevation", [-60.0, -40.0])
def test_the_pose_of_another_frame_is_named(known, R, cause, elevation):
    X_WC, depth = view(elevation)
    wrong = given(X_WC, R)

    with pytest.raises(CaptureError, match=f"Camera 'right' .*{cause}") as caught:
        check_plausible(frame(view(), (wrong, depth)), table_height=0.0 if known else None)

    assert "optical frame" in caught.value.remedy


@pytest.mark.parametrize("elevation", [-60.0, -40.0, -30.0])
def test_a_pose_that_is_inverted_is_named(elevation):
    X_WC, depth = view(elevation, (0.2, 0.0, 0.8))

    with pytest.raises(CaptureError, match=r"Camera 'left' .*the world in the camera"):
        check_plausible(frame((np.linalg.inv(X_WC), depth)), table_height=0.0)


@pytest.mark.parametrize("elevation", [-60.0, -30.0])
def test_a_pose_in_millimetres_is_named(elevation):
    X_WC, depth = view(elevation)
    X_WC[:3, 3] *= 1000.0

    with pytest.raises(CaptureError, match=r"Camera 'left' .*pose is in millimetres"):
        check_plausible(frame((X_WC, depth)), table_height=0.0)


@pytest.mark.parametrize(
    ("ratio", "table", "words"),
    [
        (1000.0, 0.0, "millimetres, but is read as metres"),
        (1000.0, None, "millimetres, but is read as metres"),
        (10.0, 0.0, "0.1 mm, but is read as 1 mm"),
        (10.0, None, "0.1 mm or 0.25 mm, but is read as 1 mm"),
        (4.0, 0.0, "0.25 mm, but is read as 1 mm"),
        (0.1, 0.0, "1 cm, but is read as 1 mm"),
        (0.001, 0.0, "metres, but is read as millimetres"),
    ],
)
def test_another_unit_of_depth_is_named(ratio, table, words):
    X_WC, depth = view()

    with pytest.raises(CaptureError, match=f"Camera 'right' .*{words}") as caught:
        check_plausible(frame(view(), (X_WC, ratio * depth)), table_height=table)

    assert "16UC1" in caught.value.remedy
    assert "depth_scale" in caught.value.remedy


def test_a_table_that_no_camera_sees_is_named():
    with pytest.raises(CaptureError, match=r"No camera sees the table at 0 m.* 0\.7[0-9] m") as e:
        check_plausible(frame(view(-60.0, table=0.75)), table_height=0.0)

    assert "poil.table_height" in e.value.remedy


def test_a_view_without_depth_is_not_judged():
    X_WC, depth = view()

    check_plausible(frame(view(), (X_WC, 0.0 * depth)), table_height=0.0)
    check_plausible(frame((X_WC, 0.0 * depth)))
    with pytest.raises(CaptureError, match="No camera measures depth"):
        check_plausible(frame((X_WC, 0.0 * depth)), table_height=0.0)
