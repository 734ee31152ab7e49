"""Depth in the view of another camera, against ray-traced depth of both cameras."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from poil_drake.geometry.depth_image import register_depth

SIZE = (60, 80)
K = np.array([[75.0, 0.0, 39.5], [0.0, 75.0, 29.5], [0.0, 0.0, 1.0]])


def pose(x=0.0, y=0.0, degrees=0.0):
    X = np.eye(4)
    X[:3, :3] = Rotation.from_euler("y", degrees, degrees=True).as_matrix()
    X[:2, 3] = x, y
    return X


def depth_of_plane(normal, distance, K_own, X_WC, size):
    """Returns the depth (H, W) at which each pixel's ray meets the plane normal . p = distance."""
    v, u = np.mgrid[: size[0], : size[1]]
    rays = np.stack([u, v, np.ones(size)], axis=-1) @ np.linalg.inv(K_own).T
    return (distance - X_WC[:3, 3] @ normal) / (rays @ X_WC[:3, :3].T @ normal)


@pytest.mark.parametrize(
    ("X_CD", "K_D", "size_D"),
    [
        pytest.param(pose(0.015), K, SIZE, id="beside"),
        # 1.6 times wider view, so that a pixel covers several of the colour camera's.
        pytest.param(
            pose(-0.014, 0.001, 1.0),
            np.array([[47.0, 0.0, 44.0], [0.0, 47.0, 24.0], [0.0, 0.0, 1.0]]),
            (49, 90),
            id="coarser, turned",
        ),
        pytest.param(
            pose(0.05),
            np.array([[160.0, 0.0, 84.5], [0.0, 160.0, 69.5], [0.0, 0.0, 1.0]]),
            (140, 190),
            id="finer",
        ),
    ],
)
def test_a_tilted_plane_is_where_the_colour_camera_sees_it(X_CD, K_D, size_D):
    normal = np.array([0.2, 0.5, 1.0])
    depth = depth_of_plane(normal, 0.7, K_D, X_CD, size_D)

    got = register_depth(depth, K_D, K, X_CD=X_CD, size=SIZE)

    wanted = depth_of_plane(normal, 0.7, K, np.eye(4), SIZE)
    # At the border, the depth camera does not see what the colour camera sees.
    inner = np.s_[4:-4, 8:-8]
    assert np.all(got[inner] > 0.0)
    # The plane's depth changes by at most 0.5 z^2 / (0.7 f) per pixel; a pixel of the depth camera
    # counts as flat, and the nearest of the pixels on it is taken.
    pixel = wanted**2 * 0.54 / 0.7 / min(K_D[0, 0], K[0, 0])
    assert np.all(np.abs(got - wanted)[inner] <= 1.5 * pixel[inner])


def test_the_same_view_stays_the_same():
    depth = depth_of_plane(np.array([0.0, 0.5, 1.0]), 0.7, K, np.eye(4), SIZE)
    depth[10:12, 20:30] = [[0.0], [np.nan]]
    depth[30, 40] = np.inf

    got = register_depth(depth, K, K, X_CD=np.eye(4), size=SIZE)

    valid = np.isfinite(depth) & (depth > 0.0)
    np.testing.assert_allclose(got[valid], depth[valid], rtol=1e-6)
    assert not np.any(got[10:12, 20:30])


def test_the_background_does_not_show_through():
    # A card at 0.4 m in front of a wall at 1 m, 50 mm beside a coarse depth camera.
    K_D, X_CD, size_D = np.array([[40.0, 0, 39.5], [0, 40.0, 29.5], [0, 0, 1]]), pose(0.05), SIZE
    v, u = np.mgrid[: size_D[0], : size_D[1]]
    x, y = (u - 39.5) / 40.0 * 0.4 + 0.05, (v - 29.5) / 40.0 * 0.4
    card = (np.abs(x) < 0.1) & (np.abs(y) < 0.08)

    got = register_depth(np.where(card, 0.4, 1.0), K_D, K, X_CD=X_CD, size=SIZE)

    v, u = np.mgrid[: SIZE[0], : SIZE[1]]
    x, y = (u - 39.5) / 75.0 * 0.4, (v - 29.5) / 75.0 * 0.4
    # Within a pixel of the depth camera, 10 mm, the edge of the card may lie on either side.
    inside = (np.abs(x) < 0.09) & (np.abs(y) < 0.07)
    np.testing.assert_allclose(got[inside], 0.4, rtol=1e-6)
    beyond = (got > 0.0) & ~((np.abs(x) < 0.11) & (np.abs(y) < 0.09))
    np.testing.assert_allclose(got[beyond], 1.0, rtol=1e-6)
    # Beside the card lies a strip of the wall that the depth camera does not see:
    # 50 mm (1 / 0.4 - 1 / 1) of the focal length, 5.6 pixels.
    assert 3 <= np.count_nonzero(got[30] == 0.0) <= 8


def test_what_is_behind_the_colour_camera_is_left_out():
    behind = pose(degrees=180.0)

    assert not register_depth(np.ones(SIZE), K, K, X_CD=behind, size=SIZE).any()


def test_no_depth_gives_no_depth():
    assert not register_depth(np.zeros(SIZE), K, K, X_CD=pose(0.01), size=(30, 40)).any()
