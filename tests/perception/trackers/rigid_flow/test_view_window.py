import numpy as np
import pytest

from poil_drake.geometry.depth_image import project
from poil_drake.geometry.rigid_transform import make_transform, rotation_exp
from poil_drake.perception.trackers.rigid_flow.view_window import make_window

POINTS = np.array([[0.45, 0.02, 0.05], [0.48, -0.03, 0.09], [0.42, 0.0, 0.01]])


@pytest.fixture
def view(mug_scene):
    frame = mug_scene.shoot(mug_scene.start).frame
    dut = make_window(frame.cameras[1], frame.images[1], POINTS)
    return dut, frame


def test_the_window_shows_the_image_around_the_points(view):
    dut, frame = view
    uv, _ = project(POINTS, frame.cameras[1].K, frame.cameras[1].X_WC)
    u0, v0 = dut.corner
    height, width = dut.depth.shape

    assert (u0, v0) == tuple(np.floor(uv.min(axis=0)).astype(int) - 24)
    np.testing.assert_array_equal(
        dut.depth, frame.images[1].depth[v0 : v0 + height, u0 : u0 + width]
    )


def test_points_project_to_the_same_pixels_as_in_the_image(view):
    dut, frame = view
    X_WO = make_transform(rotation_exp(np.array([0.3, -0.2, 0.5])), np.array([0.4, 0.1, 0.0]))
    uv, z = project(POINTS, frame.cameras[1].K, frame.cameras[1].X_WC)
    points_O = (POINTS - X_WO[:3, 3]) @ X_WO[:3, :3]

    posed = dut.at(X_WO)
    u, v = posed.project(points_O)

    np.testing.assert_allclose(np.stack([u, v], axis=1) + dut.corner, uv, atol=1e-9)
    np.testing.assert_allclose(posed.to_camera(points_O)[:, 2], z, atol=1e-12)
    np.testing.assert_allclose(posed.unproject(u, v, z), points_O, atol=1e-12)


def test_pixel_gradients_are_the_projection_s_derivative(view):
    dut, _ = view
    posed = dut.at(np.eye(4))
    du, dv, h = np.array([0.6, 1.0, 0.0]), np.array([-0.8, 0.0, 1.0]), 1e-6

    gradient = posed.pixel_gradient(du, dv, POINTS)

    for axis in range(3):
        step = h * np.eye(3)[axis]
        (u1, v1), (u0, v0) = posed.project(POINTS + step), posed.project(POINTS - step)
        expected = (du * (u1 - u0) + dv * (v1 - v0)) / (2 * h)
        np.testing.assert_allclose(gradient[:, axis], expected, rtol=1e-6, atol=1e-3)


def test_pixels_at_depth_edges_are_not_surface(view):
    dut, _ = view

    # The outline of the mug in front of the table has depth, but no surface.
    at_edges = (dut.depth > 0) & (dut.surface == 0)
    assert 100 < np.count_nonzero(at_edges) < 0.2 * at_edges.size
    np.testing.assert_array_equal(dut.surface[~at_edges], dut.depth[~at_edges])


@pytest.mark.parametrize("away", [[0.0, 0.0, 5.0], [3.0, 0.0, 0.0]])
def test_there_is_no_window_where_the_points_are_out_of_view(view, away):
    _, frame = view

    assert make_window(frame.cameras[0], frame.images[0], POINTS + away) is None
