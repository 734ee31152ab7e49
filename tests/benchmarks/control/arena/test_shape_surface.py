import numpy as np
import pytest
from pydrake.geometry import Box, Capsule, Cylinder, HalfSpace, Sphere
from scipy.spatial import cKDTree

from poil_drake.benchmarks.control.arena.shape_surface import shape_surface as dut
from poil_drake.errors import InvalidValueError


def largest_gap(points, samples):
    return cKDTree(points).query(samples)[0].max()


def test_box_points_lie_on_its_faces_and_leave_no_gap():
    points = dut(Box(0.1, 0.2, 0.3), 0.02)

    half = np.array([0.05, 0.1, 0.15])
    assert np.all(np.abs(points) <= half + 1e-12)
    assert np.all(np.isclose(np.abs(points), half).any(axis=1))
    rng = np.random.default_rng(0)
    samples = rng.uniform(-half, half, size=(500, 3))
    samples[:, 0] = 0.05
    # At most half the diagonal of a cell.
    assert largest_gap(points, samples) <= 0.02 / np.sqrt(2) + 1e-12


def test_sphere_points_are_its_radius_away():
    points = dut(Sphere(0.05), 0.01)

    np.testing.assert_allclose(np.linalg.norm(points, axis=1), 0.05)
    directions = np.random.default_rng(0).normal(size=(500, 3))
    samples = 0.05 * directions / np.linalg.norm(directions, axis=1, keepdims=True)
    assert largest_gap(points, samples) < 0.01


def test_capsule_points_are_its_radius_away_from_its_line():
    points = dut(Capsule(0.02, 0.1), 0.005)

    nearest = np.clip(points[:, 2], -0.05, 0.05)
    offsets = points - np.stack([0 * nearest, 0 * nearest, nearest], axis=1)
    np.testing.assert_allclose(np.linalg.norm(offsets, axis=1), 0.02)
    assert points[:, 2].max() == pytest.approx(0.07)


def test_cylinder_has_a_side_and_two_lids():
    points = dut(Cylinder(0.02, 0.1), 0.005)

    radii = np.hypot(points[:, 0], points[:, 1])
    side, lid = np.isclose(radii, 0.02), np.isclose(np.abs(points[:, 2]), 0.05)
    assert np.all(side | lid)
    assert radii[lid].min() == 0.0
    assert np.ptp(points[side, 2]) == pytest.approx(0.1)


def test_unsupported_shapes_are_rejected():
    with pytest.raises(InvalidValueError, match="HalfSpace"):
        dut(HalfSpace(), 0.01)
