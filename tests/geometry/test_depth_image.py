import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from poil_drake.errors import InvalidValueError
from poil_drake.geometry import depth_image as dut
from poil_drake.geometry.rigid_transform import make_transform, rotation_exp, transform_points

K = np.array([[100.0, 0.0, 31.5], [0.0, 120.0, 23.5], [0.0, 0.0, 1.0]])


def plane_depth(normal, distance, K=K, shape=(48, 64)):
    """Depth where the rays meet the plane normal . p = distance."""
    v, u = np.mgrid[: shape[0], : shape[1]]
    rays = np.stack([(u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1], np.ones(shape)], axis=-1)
    return distance / (rays @ normal)


def test_pixel_at_the_principal_point_lies_on_the_axis():
    K_even = np.array([[100.0, 0, 2.0], [0, 100.0, 1.0], [0, 0, 1.0]])
    depth = np.zeros((3, 5), dtype=np.float32)
    depth[1, 2], depth[0, 4] = 2.0, 1.0

    points, pixels = dut.unproject(depth, K_even, np.ones((3, 5), dtype=bool))

    assert pixels.tolist() == [[4, 0], [2, 1]]
    np.testing.assert_allclose(points, [[0.02, -0.01, 1.0], [0.0, 0.0, 2.0]])


def test_invalid_and_masked_pixels_are_excluded():
    depth = np.array([[1.0, 0.0, np.nan, np.inf, -1.0, 1.0]], dtype=np.float32)
    mask = np.array([[True, True, True, True, True, False]])

    _, pixels = dut.unproject(depth, K, mask)

    assert pixels.tolist() == [[0, 0]]


def test_projection_undoes_unprojection():
    rng = np.random.default_rng(0)
    depth = rng.uniform(0.5, 2.0, size=(48, 64))
    X_WC = make_transform(rotation_exp(rng.normal(size=3)), rng.normal(size=3))
    points_C, pixels = dut.unproject(depth, K, np.ones((48, 64), dtype=bool))

    uv, z = dut.project(transform_points(X_WC, points_C), K, X_WC)

    np.testing.assert_allclose(uv, pixels, atol=1e-10)
    np.testing.assert_allclose(z, depth.ravel(), atol=1e-12)


def test_point_behind_the_camera_has_no_pixel():
    uv, z = dut.project(np.array([[0.0, 0.0, -1.0]]), K, np.eye(4))

    assert np.isnan(uv).all()
    assert z.tolist() == [-1.0]


@given(st.floats(-0.8, 0.8), st.floats(-0.8, 0.8), st.integers(1, 3), st.integers(0, 2))
@settings(derandomize=True, max_examples=50)
def test_normals_of_planes_are_exact_and_face_the_camera(x, y, step, smoothing):
    normal = np.array([x, y, 1.0]) / np.linalg.norm([x, y, 1.0])

    normals = dut.depth_normals(
        plane_depth(normal, 1.0), K, step=step, smoothing=smoothing, relative_jump=0.1
    )

    inside = normals[5:-5, 5:-5].reshape(-1, 3)
    np.testing.assert_allclose(inside, np.broadcast_to(-normal, inside.shape), atol=2e-4)


def test_normals_are_missing_at_the_image_border_and_around_jumps_and_holes():
    depth = np.ones((20, 30))
    depth[:, 15:] = 2.0
    depth[10, 5] = 0.0

    normals = dut.depth_normals(depth, K)

    expected = np.zeros((20, 30), dtype=bool)
    expected[[0, -1]] = expected[:, [0, -1]] = True
    expected[:, 14:16] = True
    expected[10, 4:7] = expected[9:12, 5] = True
    np.testing.assert_array_equal(np.isnan(normals).any(axis=2), expected)


def test_smoothing_does_not_reach_across_a_jump():
    tilted = plane_depth(np.array([0.6, 0.0, 0.8]), 1.0, shape=(20, 30))
    depth = np.where(np.arange(30) < 15, 3.0, tilted)

    normals = dut.depth_normals(depth, K, smoothing=2, relative_jump=0.1)

    left, right = normals[5:15, 5:14].reshape(-1, 3), normals[5:15, 16:25].reshape(-1, 3)
    np.testing.assert_allclose(left, np.broadcast_to([0, 0, -1.0], left.shape), atol=1e-5)
    # Beside the jump the box is one-sided, and the slope in the image changes a little over it.
    np.testing.assert_allclose(right, np.broadcast_to([-0.6, 0, -0.8], right.shape), atol=5e-3)


def test_image_smaller_than_the_step_has_no_normals():
    assert np.isnan(dut.depth_normals(np.ones((2, 9)), K)).all()


def test_erosion_removes_a_border():
    mask = np.zeros((9, 9), dtype=bool)
    mask[2:7, 2:7] = True
    expected = np.zeros((9, 9), dtype=bool)
    expected[3:6, 3:6] = True

    np.testing.assert_array_equal(dut.erode_mask(mask, 0), mask)
    np.testing.assert_array_equal(dut.erode_mask(mask, 1), expected)


def test_mask_is_not_eroded_at_the_image_border():
    assert dut.erode_mask(np.ones((5, 5), dtype=bool), 1).all()


def test_both_sides_of_a_large_relative_jump_are_edges():
    depth = np.array([[1.0, 1.0, 1.04, 1.06, 2.0, 0.0, 1.0]])

    # The jumps are 0, 4 %, 1.9 %, 89 %; an invalid pixel makes none.
    assert dut.depth_edges(depth, 0.03).tolist() == [[False, True, True, True, True, False, False]]
    assert dut.depth_edges(depth.T, 0.5).ravel().tolist() == [False] * 3 + [True] * 2 + [False] * 2


def test_clean_mask_keeps_reliable_depth_away_from_edges():
    depth = np.full((7, 12), 1.0, dtype=np.float32)
    depth[:, 6:] = 1.5
    depth[3, 1] = 0.0
    depth[3, 10] = 9.0
    mask = np.ones((7, 12), dtype=bool)
    mask[:, 0] = False
    config = dut.DepthMaskConfig(erosion=0, edge_margin=1, relative_jump=0.03, max_depth=3.0)

    cleaned = dut.clean_mask(mask, depth, np.diag([1000.0, 1000.0, 1.0]), config)

    assert cleaned[0].tolist() == [False] + [True] * 3 + [False] * 4 + [True] * 4
    assert not cleaned[3, 1]
    assert not cleaned[3, 10]
    # The far pixel is itself a jump, so its neighbours go too.
    assert not cleaned[3, 9]
    assert cleaned[3, 2]


@pytest.mark.parametrize(("focal", "width"), [(600.0, 4), (200.0, 6)])
def test_thin_parts_keep_their_border_in_coarse_images(focal: float, width: int):
    """At 0.6 m, pixels cover 1 mm or 3 mm; more than 2 mm is coarse."""
    depth = np.full((20, 8), 0.6, dtype=np.float32)
    mask = np.zeros(depth.shape, dtype=bool)
    mask[:, 1:7] = True

    cleaned = dut.clean_mask(mask, depth, np.diag([focal, focal, 1.0]), dut.DepthMaskConfig())

    assert cleaned[10].sum() == width
    assert dut.pixel_size(mask, depth, np.diag([focal, focal, 1.0])) == pytest.approx(0.6 / focal)


def test_mask_of_another_size_is_rejected():
    with pytest.raises(InvalidValueError, match=r"\(2, 2\)"):
        dut.clean_mask(
            np.ones((2, 2), dtype=bool), np.ones((3, 3)), np.eye(3), dut.DepthMaskConfig()
        )
