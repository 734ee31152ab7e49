import numpy as np
import pytest

from poil_drake.perception.images import CameraModel, RgbdImage
from poil_drake.perception.trackers.rigid_points.sight import lift_pixels, visible

K = np.array([[100.0, 0.0, 20.0], [0.0, 100.0, 15.0], [0.0, 0.0, 1.0]])
X_WC = np.diag([1.0, -1.0, -1.0, 1.0])  # looks straight down from 1 m
X_WC[:3, 3] = [0.5, 0.0, 1.0]
CAMERA = CameraModel("above", 40, 30, K, X_WC)


def view(**depths):
    """A floor 1 m below, a board 0.2 m above its right half, and what `depths` changes."""
    depth = np.ones((30, 40), np.float32)
    depth[:, 25:] = 0.8
    for where, value in depths.items():
        row, column = map(int, where.removeprefix("at_").split("_"))
        depth[row, column] = value
    return RgbdImage(np.zeros((30, 40, 3), np.uint8), depth, 0.0)


def test_pixels_are_lifted_onto_the_surfaces_that_they_show():
    # 10 px right of the centre on the floor is 0.1 m; 8 px further on the board is 18 px of 8 mm.
    points = lift_pixels(np.array([[10.0, 15.0], [38.0, 20.0]]), CAMERA, view())

    np.testing.assert_allclose(points, [[0.4, 0.0, 0.0], [0.644, -0.04, 0.2]], atol=1e-6)


@pytest.mark.parametrize(
    "pixel", [[25.0, 15.0], [-3.0, 5.0], [10.0, 29.6], [np.nan, np.nan]], ids=str
)
def test_pixels_at_a_depth_edge_or_outside_are_not_lifted(pixel):
    assert np.isnan(lift_pixels(np.array([pixel]), CAMERA, view())).all()


def test_a_pixel_needs_five_depths_around_it():
    four_holes = dict.fromkeys(["at_9_9", "at_9_10", "at_9_11", "at_10_9"], 0.0)
    five_holes = four_holes | {"at_10_10": 0.0}
    pixel = np.array([[10.0, 10.0]])

    assert np.isfinite(lift_pixels(pixel, CAMERA, view(**four_holes))).all()
    assert np.isnan(lift_pixels(pixel, CAMERA, view(**five_holes))).all()


def test_points_are_visible_on_the_measured_surface_only():
    points = np.array(
        [
            [0.4, 0.0, 0.005],  # on the floor
            [0.6, 0.0, 0.2],  # on the board
            [0.62, 0.0, 0.0],  # under the board
            [0.4, 0.0, 0.05],  # above the floor
            [0.5, 0.0, 1.5],  # behind the camera
        ]
    )

    seen = visible(points, CAMERA, view())

    np.testing.assert_array_equal(seen, [True, True, False, False, False])
