import numpy as np
import pytest

from poil_drake.geometry.depth_image import unproject
from poil_drake.perception.images import CameraModel, MultiViewFrame, RgbdImage
from poil_drake.perception.trackers.rigid_flow.coarse_views import (
    doubled,
    doubled_mask,
    is_coarse,
)

K = np.array([[40.0, 0.0, 11.5], [0.0, 40.0, 7.5], [0.0, 0.0, 1.0]])
CAMERA = CameraModel("left", 24, 16, K, np.eye(4))
NORMAL = np.array([0.3, -0.2, -1.0])  # of a slanted plane, on which normal . point = -0.6


def view(depth):
    image = RgbdImage(np.full((*depth.shape, 3), 90, np.uint8), depth.astype(np.float32), 0.5)
    return MultiViewFrame((CAMERA,), (image,))


def plane_depth():
    v, u = np.indices((16, 24))
    rays = np.stack([(u - 11.5) / 40.0, (v - 7.5) / 40.0, np.ones((16, 24))], axis=-1)
    return -0.6 / (rays @ NORMAL)


def test_pixels_are_coarse_if_they_cover_more_than_2_mm_at_the_object() -> None:
    assert is_coarse(CAMERA, np.array([0.0, 0.0, 0.081]))
    assert not is_coarse(CAMERA, np.array([0.0, 0.0, 0.079]))


def test_a_plane_stays_where_it_is() -> None:
    frame = doubled(view(plane_depth()), [True])

    camera, image = frame.cameras[0], frame.images[0]
    assert (camera.width, camera.height) == (48, 32)
    assert image.rgb.shape == (32, 48, 3)
    inner = np.zeros((32, 48), dtype=bool)
    inner[2:-2, 2:-2] = True
    points, _ = unproject(image.depth, camera.K, inner)
    assert np.abs(points @ NORMAL + 0.6).max() < 1e-4


def test_depth_is_not_interpolated_across_edges() -> None:
    depth = np.full((16, 24), 0.9)
    depth[:, 10:14] = 0.6

    image = doubled(view(depth), [True]).images[0]

    assert set(np.unique(image.depth)) == {np.float32(0.6), np.float32(0.9)}
    np.testing.assert_array_equal(image.depth == np.float32(0.6), doubled_mask(depth == 0.6))


def test_flying_and_invalid_pixels_get_no_copies() -> None:
    depth = np.full((16, 24), 0.9)
    depth[5, 5], depth[9, 9] = 0.7, 0.0

    image = doubled(view(depth), [True]).images[0]

    for row, column in ((5, 5), (9, 9)):
        block = image.depth[2 * row : 2 * row + 2, 2 * column : 2 * column + 2]
        np.testing.assert_array_equal(block, 0.0)
    assert np.unique(image.depth[image.depth > 0.0]) == pytest.approx([0.9])


def test_fine_views_are_not_changed() -> None:
    frame = view(plane_depth())

    assert doubled(frame, [False]) is frame
