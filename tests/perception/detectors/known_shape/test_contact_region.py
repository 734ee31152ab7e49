import numpy as np
from box_scene import BODY, CUP, HANDLE, HUNG, ROD, Box, box, surface
from scipy.spatial import cKDTree

from poil_drake.geometry.rigid_transform import inverse
from poil_drake.perception.detectors.known_shape.contact_region import (
    contact_region,
    grown_along_thin_piece,
)

BODY_SIDE = BODY[0].half[0]
"""The x coordinate at which the cup's handle begins."""


def test_what_a_rod_touches_is_the_handle_up_to_the_body() -> None:
    points = surface(CUP).points
    rod = Box(inverse(HUNG) @ ROD.X, ROD.half)
    distances = cKDTree(surface((rod,)).points).query(points)[0]

    dut = contact_region(points, distances)

    is_handle = points[:, 0] > BODY_SIDE + 1e-6
    assert dut[is_handle].all()
    # One ring of 6 mm reaches onto the body, around the handle's two ends.
    assert points[dut, 0].min() > BODY_SIDE - 1e-6
    assert (dut & ~is_handle).sum() < 0.25 * dut.sum()


def test_on_a_flat_side_a_region_hardly_grows() -> None:
    plate = surface((box([0.0, 0.0, -0.01], [0.06, 0.06, 0.01]),)).points
    # From a point 5 mm above, the region is a disc with a radius of 8.7 mm. The next ring is
    # 1.7 times as wide.
    distances = np.linalg.norm(plate - [0.0, 0.0, 0.005], axis=1)

    dut = contact_region(plate, distances)

    start = distances < distances.min() + 0.005
    assert dut[start].all()
    # Pieces of the ring may join; not even one whole ring does.
    assert dut.sum() < 2.0 * start.sum()
    assert np.linalg.norm(plate[dut, :2], axis=1).max() < 0.0087 + 0.006


def test_a_region_grows_over_a_whole_rod() -> None:
    rod = surface((box([0.0, 0.0, 0.0], [0.06, 0.004, 0.004]),)).points

    dut = grown_along_thin_piece(rod, rod[:, 0] < -0.05)

    assert dut.all()


def test_a_region_does_not_jump_to_a_piece_apart() -> None:
    handle = surface(HANDLE).points
    points = np.concatenate([handle, handle + np.array([0.0, 0.03, 0.0])])

    dut = grown_along_thin_piece(points, np.abs(points - [0.06, 0.0, 0.04]).max(axis=1) < 0.005)

    np.testing.assert_array_equal(dut, np.arange(2 * len(handle)) < len(handle))
