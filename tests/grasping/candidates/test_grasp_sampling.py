import numpy as np
import pytest
from numpy.testing import assert_allclose
from point_grids import point_grid

from poil_drake.errors import InvalidValueError
from poil_drake.geometry.point_cloud import PointCloud
from poil_drake.geometry.rigid_transform import inverse, transform_points
from poil_drake.grasping.candidates.grasp_candidate import (
    GRIPPER,
    GraspCandidate,
    GraspSamplingConfig,
)
from poil_drake.grasping.candidates.sampling import (
    approach_directions,
    sample_antipodal_grasps,
    wall_normals,
)

SOME = GraspSamplingConfig(seed_points=100)
NO_PART = np.zeros((0, 3))
PLACE = np.array([0.45, -0.10, 0.0])


def box_cloud(size: np.ndarray) -> PointCloud:
    """The sides and the top of a box on the table, centred at PLACE."""
    x, y, z = (np.arange(0.0, s + 1e-9, 0.003) - 0.5 * s for s in size)
    faces = [
        point_grid(x, y[[0, -1]], z),
        point_grid(x[[0, -1]], y, z),
        point_grid(x, y, z[-1]),
    ]
    points = np.concatenate(faces) + PLACE + [0.0, 0.0, 0.5 * size[2] + 0.001]
    return PointCloud(points + np.random.default_rng(1).normal(0.0, 0.0003, points.shape))


def tip_depth_below(grasp: GraspCandidate, height: float) -> float:
    tip = transform_points(grasp.X_WG, np.array([0.0, 0.0, GRIPPER.tip_end]))
    return height - tip[2]


def test_box_is_grasped_across_its_narrow_side():
    # 0.12 m does not fit into the hand, 0.05 m does.
    grasps = sample_antipodal_grasps(box_cloud(np.array([0.12, 0.05, 0.08])), NO_PART)

    assert grasps
    for grasp in grasps:
        assert abs(grasp.X_WG[1, 1]) > np.cos(0.25)
        # Turned by 0.25 rad, the 18 mm wide pads span 4.5 mm more.
        assert_allclose(grasp.width, 0.05, atol=0.006)
        assert_allclose(grasp.X_WG[1, 3], PLACE[1], atol=0.003)
        assert grasp.pregrasp_width <= 0.08


def test_box_too_wide_for_the_hand_has_no_grasp():
    assert sample_antipodal_grasps(box_cloud(np.array([0.12, 0.10, 0.08])), NO_PART) == []


def test_cylinder_is_grasped_through_its_axis(make_tube):
    side = make_tube(0.025, np.arange(0.003, 0.1, 0.003))
    lid = [make_tube(radius, np.array([0.1])) for radius in np.arange(0.003, 0.025, 0.003)]

    grasps = sample_antipodal_grasps(
        PointCloud(np.concatenate([side, *lid]) + PLACE), NO_PART, config=SOME
    )

    assert grasps
    for grasp in grasps:
        # The friction angle of 0.4 rad allows an offset of 25 mm sin 0.4.
        sideways = np.cross(grasp.X_WG[:3, 1], [0.0, 0.0, 1.0])
        assert abs(sideways @ (PLACE - grasp.X_WG[:3, 3])) < 0.0098
        assert_allclose(grasp.width, 0.05, atol=0.005)


def test_mug_is_grasped_at_its_rim_across_the_wall(mug, rim_grasps):
    assert len(rim_grasps) >= 30
    rim = [grasp for grasp in rim_grasps if grasp.width < 0.012]
    assert len(rim) >= 20
    for grasp in rim:
        outward = (grasp.X_WG[:3, 3] - mug.center)[:2]
        assert_allclose(np.linalg.norm(outward), mug.radius - 0.5 * mug.wall, atol=0.002)
        radial = outward / np.linalg.norm(outward)
        assert abs(grasp.X_WG[:2, 1] @ radial) > np.cos(0.35)
        assert 0.008 < tip_depth_below(grasp, mug.height) < 0.020
        # The inner finger must fit into the mug.
        assert grasp.pregrasp_width < 0.035


def test_rim_grasps_are_distributed_around_the_mug(mug, rim_grasps):
    offsets = np.array([grasp.X_WG[:2, 3] for grasp in rim_grasps]) - mug.center[:2]
    sectors = np.floor(np.arctan2(offsets[:, 1], offsets[:, 0]) / (np.pi / 4.0))
    assert len(set(sectors)) >= 7


def test_wall_seen_from_one_side_only_is_still_grasped_at_its_rim(make_tube):
    outside = make_tube(0.04, np.arange(0.002, 0.095, 0.003))

    grasps = sample_antipodal_grasps(PointCloud(outside + PLACE), NO_PART, config=SOME)

    assert sum(grasp.width < 0.012 for grasp in grasps) >= 20


def test_gripper_keeps_clear_of_the_part(mug):
    config = GraspSamplingConfig(part_clearance=0.015, seed_points=60)

    grasps = sample_antipodal_grasps(mug.cloud, mug.part_points, config=config)

    assert grasps
    for grasp in grasps:
        part_G = transform_points(inverse(grasp.X_WG), mug.part_points)
        lower, upper = GRIPPER.finger_boxes(grasp.pregrasp_width)
        hand_lower, hand_upper = GRIPPER.hand_box()
        for low, high in zip([*lower, hand_lower], [*upper, hand_upper], strict=True):
            outside = np.maximum(np.maximum(low - part_G, part_G - high), 0.0)
            assert np.linalg.norm(outside, axis=1).min() >= config.part_clearance


def test_open_gripper_does_not_touch_the_object(mug, rim_grasps):
    for grasp in rim_grasps:
        points_G = transform_points(inverse(grasp.X_WG), mug.cloud.points)
        lower, upper = GRIPPER.finger_boxes(grasp.pregrasp_width)
        for low, high in zip(lower, upper, strict=True):
            # Points just inside a face are noise; thinning may leave a few deeper ones.
            inside = np.all((points_G > low + 0.002) & (points_G < high - 0.002), axis=1)
            assert np.count_nonzero(inside) <= 5


def test_obstacle_over_one_side_leaves_grasps_elsewhere(mug):
    # The hand is 63.5 mm wide across its closing axis.
    shelf = mug.center + point_grid(
        np.arange(-0.1, 0.1, 0.005), np.arange(0.035, 0.1, 0.005), mug.height + 0.05
    )

    grasps = sample_antipodal_grasps(mug.cloud, mug.part_points, obstacle_points=shelf, config=SOME)

    assert grasps
    assert all(grasp.X_WG[1, 3] < mug.center[1] + 0.01 for grasp in grasps)


def test_half_turns_are_included(rim_grasps):
    turned = rim_grasps[0].X_WG @ np.diag([-1.0, -1.0, 1.0, 1.0])
    assert any(np.allclose(grasp.X_WG, turned) for grasp in rim_grasps)


def test_approach_is_within_the_angle_and_orthogonal_to_closing():
    axis = np.array([0.8, 0.6, 0.0])

    directions = approach_directions(axis, 16, np.radians(50.0))

    # 16 spins are 22.5 deg apart; 50 deg include 0, 22.5 and 45 deg to either side.
    assert len(directions) == 5
    assert_allclose(directions @ axis, 0.0, atol=1e-12)
    assert_allclose(directions[0], [0.0, 0.0, -1.0], atol=1e-12)
    assert_allclose(np.sort(-directions[:, 2]), np.cos(np.radians([45, 45, 22.5, 22.5, 0])))


def test_wall_normal_spans_both_faces_of_a_thin_wall():
    sides = np.arange(0.0, 0.06, 0.003)

    normals = wall_normals(point_grid(np.array([0.0, 0.0035]), sides, sides), 0.010)

    assert np.abs(normals[:, 0]).min() > np.cos(0.2)


def test_rejects_too_few_points():
    with pytest.raises(InvalidValueError, match="has 3 points; 8 are needed"):
        sample_antipodal_grasps(PointCloud(np.eye(3)), NO_PART)
