from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from poil_drake.errors import TransferError
from poil_drake.geometry.point_cloud import PointCloud
from poil_drake.geometry.rigid_transform import rotation_angle
from poil_drake.transfer.alignment.coarse_alignment import (
    MODE_ANGLE,
    SYMMETRY_TOLERANCE,
    CoarseAlignment,
    align_parts,
    distinct_rotations,
    half_turns,
    symmetric_alignments,
)
from poil_drake.transfer.alignment.problem import AlignmentProblem, CoarseAlignmentConfig

Maker = Callable[..., PointCloud]

# Far from upright, which the prior for upright objects would penalise.
R_TRUE = Rotation.from_rotvec([1.7, -0.9, 0.6]).as_matrix()
P_TRUE = np.array([0.4, -0.2, 0.1])
PART_ALONE = CoarseAlignmentConfig(upright_weight=0.0)


def align(
    source: PointCloud,
    target: PointCloud,
    config: CoarseAlignmentConfig = PART_ALONE,
    **contexts: PointCloud,
) -> list[CoarseAlignment]:
    return align_parts(AlignmentProblem.between(source, target, config=config, **contexts))


def moved(cloud: PointCloud, R: np.ndarray = R_TRUE, p: np.ndarray = P_TRUE) -> PointCloud:
    return PointCloud(cloud.points @ R.T + p, cloud.normals @ R.T)


def scaled(cloud: PointCloud, scales: list[float], *, along: PointCloud) -> PointCloud:
    """Returns a cloud scaled along the principal axes of another."""
    center = along.points.mean(axis=0)
    _, U = np.linalg.eigh((along.points - center).T @ (along.points - center))
    return PointCloud((cloud.points - center) @ (U * scales) @ U.T + center, cloud.normals)


def angle_to(found: CoarseAlignment, R: np.ndarray) -> float:
    return float(np.rad2deg(rotation_angle(found.rotation @ R.T)))


def test_recovers_pose_and_scales_along_the_principal_axes(make_handle: Maker) -> None:
    source = make_handle(seed=0)
    scales = [1.0, 1.25, 0.8]
    target = moved(scaled(make_handle(seed=1), scales, along=source))

    # Without the prior, which draws scales towards one.
    best = align(source, target, replace(PART_ALONE, scale_weight=0.0))[0]

    assert angle_to(best, R_TRUE) < 3.0
    np.testing.assert_allclose(best.scales[1:], scales[1:], rtol=0.06)
    # The true positions; 1 mm is a quarter of the tube's radius.
    truth = moved(scaled(source, scales, along=source)).points
    assert np.linalg.norm(best.apply(source.points) - truth, axis=1).mean() < 0.0015


def test_views_from_different_sides_align(make_handle: Maker) -> None:
    source = make_handle(seed=0, sides=(-1.2, 1.2), noise=0.0007)
    target = moved(make_handle(seed=1, sides=(0.4, 2.8), noise=0.0007))

    best = align(source, target)[0]

    # The two sides of the tube, 8 mm thick and 60 mm long, are a few mm apart.
    assert angle_to(best, R_TRUE) < 8.0


def test_aligns_with_a_partial_view_of_the_target(make_handle: Maker) -> None:
    source = make_handle(seed=0)
    whole = make_handle(seed=1)
    lower = whole.points[:, 2]
    target = moved(whole.select(lower > np.quantile(lower, 0.25)))

    best = align(source, target)[0]

    assert angle_to(best, R_TRUE) < 10.0


def test_the_modes_of_a_symmetric_part_contain_the_half_turn(make_handle: Maker) -> None:
    source, target = make_handle("c", seed=0), moved(make_handle("c", seed=1))
    # About the direction in which the handle protrudes.
    half_turn = np.diag([1.0, -1.0, -1.0])

    found = align(source, target)

    for R in (R_TRUE, R_TRUE @ half_turn):
        assert min(angle_to(a, R) for a in found[:2]) < 5.0
    assert found[1].cost < found[0].cost + 0.1
    # Modes are distinct, the best first.
    costs = [a.cost for a in found]
    assert costs == sorted(costs)
    for k, a in enumerate(found):
        assert all(angle_to(a, b.rotation) > np.rad2deg(MODE_ANGLE) for b in found[:k])


def test_the_rest_of_the_object_resolves_the_half_turn(
    make_handle: Maker, make_body: Maker
) -> None:
    handle, body = make_handle("c", seed=0), make_body(seed=0)
    target, target_body = moved(make_handle("c", seed=1)), moved(make_body(seed=1))

    found = align(handle, target, source_context=body, target_context=target_body)

    assert angle_to(found[0], R_TRUE) < 3.0
    assert found[1].cost > found[0].cost + 0.02


def test_of_equal_fits_the_upright_one_is_best(make_handle: Maker) -> None:
    turn = Rotation.from_rotvec([0.0, 0.0, 2.0]).as_matrix()
    target = moved(make_handle("c", seed=1), turn)

    found = align(make_handle("c", seed=0), target, CoarseAlignmentConfig())

    assert angle_to(found[0], turn) < 5.0


def test_rejects_too_few_points(make_handle: Maker) -> None:
    few = make_handle(count=5)

    with pytest.raises(TransferError, match="target part has only 5 points"):
        align(make_handle(), few)


def test_distinct_rotations_keep_the_cheapest_of_each_group() -> None:
    angles = np.deg2rad([0.0, 5.0, 90.0, 93.0, 180.0])
    R = Rotation.from_rotvec(angles[:, None] * [0.0, 0.0, 1.0]).as_matrix()
    costs = np.array([3.0, 2.0, 1.0, 0.5, 4.0])

    kept = distinct_rotations(R, costs, angle=np.deg2rad(20.0), count=10)

    np.testing.assert_array_equal(kept, [3, 1, 4])
    assert len(distinct_rotations(R, costs, angle=np.deg2rad(20.0), count=2)) == 2


def test_a_box_is_symmetric_about_all_its_axes() -> None:
    box = np.stack(np.meshgrid(*[np.linspace(0.7, 1.7, 7)] * 3), axis=-1) * [0.1, 0.06, 0.03]

    turns, chamfers = half_turns(box.reshape(-1, 3))

    # Largest extent first.
    expected = [np.diag([1, -1, -1]), np.diag([-1, 1, -1]), np.diag([-1, -1, 1])]
    np.testing.assert_allclose(turns, expected, atol=1e-9)
    np.testing.assert_allclose(chamfers, 0.0, atol=1e-9)


def test_a_handle_is_symmetric_about_the_direction_in_which_it_protrudes(
    make_handle: Maker,
) -> None:
    turns, chamfers = half_turns(make_handle("c", count=800).points)

    # Along x: there the half turn is diag(1, -1, -1).
    np.testing.assert_array_equal(chamfers <= SYMMETRY_TOLERANCE, turns[:, 0, 0] > 0.99)


def test_an_ear_is_less_symmetric_than_a_half_circle(make_handle: Maker) -> None:
    ear, half_circle = (
        half_turns(make_handle(shape, count=800).points)[1].min() for shape in ("ear", "c")
    )

    assert ear > 1.5 * half_circle


def align_handles(make_handle: Maker, shape: str, **config: float) -> list[CoarseAlignment]:
    source, target = make_handle(shape), make_handle(shape, seed=1)
    problem = AlignmentProblem.between(source, target, config=replace(PART_ALONE, **config))
    return symmetric_alignments(problem, target.points)


def test_a_symmetric_part_has_alternatives(make_handle: Maker) -> None:
    found = align_handles(make_handle, "c")

    assert len(found) == 2
    turn = rotation_angle(found[0].rotation.T @ found[1].rotation)
    np.testing.assert_allclose(np.rad2deg(turn), 180.0, atol=8.0)


def test_a_half_turn_that_the_search_did_not_find_is_refined(make_handle: Maker) -> None:
    assert len(align_handles(make_handle, "c", max_modes=1)) == 2


def test_an_asymmetric_part_has_no_alternatives(make_handle: Maker) -> None:
    assert len(align_handles(make_handle, "ear")) == 1


def test_alignments_beyond_the_cost_margin_are_left_out(make_handle: Maker) -> None:
    assert len(align_handles(make_handle, "c", cost_margin=0.0)) == 1
