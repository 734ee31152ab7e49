from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from poil_drake.geometry import rigid_fit
from poil_drake.geometry.rigid_fit import choose_triples, kabsch, rigid_inliers
from poil_drake.geometry.rigid_transform import make_transform, rotation_exp, transform_points

property_test = settings(derandomize=True, max_examples=100)
DISTANCE = 0.005


def random_transform(rng):
    return make_transform(rotation_exp(rng.normal(size=3)), rng.normal(size=3))


@given(st.integers(0, 2**32 - 1), st.integers(3, 20))
@property_test
def test_exact_motion_is_recovered(seed, count):
    rng = np.random.default_rng(seed)
    source = rng.normal(size=(count, 3))
    X = random_transform(rng)

    np.testing.assert_allclose(kabsch(source, transform_points(X, source)), X, atol=1e-9)


@given(st.integers(0, 2**32 - 1))
@property_test
def test_noisy_weighted_rotation_agrees_with_scipy(seed):
    rng = np.random.default_rng(seed)
    source, target = rng.normal(size=(2, 8, 3))
    weights = rng.uniform(0.1, 1.0, size=8)
    share = weights / weights.sum()
    centred_source, centred_target = source - share @ source, target - share @ target
    expected, _ = Rotation.align_vectors(centred_target, centred_source, weights)

    X = kabsch(source, target, weights)

    np.testing.assert_allclose(X[:3, :3], expected.as_matrix(), atol=1e-7)
    np.testing.assert_allclose(X[:3, :3] @ (share @ source) + X[:3, 3], share @ target, atol=1e-12)


def test_mirrored_and_planar_points_get_a_rotation():
    source = np.random.default_rng(0).normal(size=(6, 3))
    plane = np.array([[0.0, 0, 0], [1, 0, 0], [0, 2, 0], [1, 1, 0]])
    X = random_transform(np.random.default_rng(1))

    mirrored = kabsch(source, source * [1.0, 1.0, -1.0])

    assert np.linalg.det(mirrored[:3, :3]) == pytest.approx(1.0)
    np.testing.assert_allclose(kabsch(plane, transform_points(X, plane)), X, atol=1e-12)


def test_collinear_points_are_mapped_onto_their_targets():
    source = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]])
    target = transform_points(random_transform(np.random.default_rng(2)), source)

    X = kabsch(source, target)

    np.testing.assert_allclose(transform_points(X, source), target, atol=1e-12)
    np.testing.assert_allclose(X[:3, :3] @ X[:3, :3].T, np.eye(3), atol=1e-12)


def test_points_of_weight_zero_may_be_nan():
    rng = np.random.default_rng(3)
    source = rng.normal(size=(5, 3))
    X = random_transform(rng)
    target = transform_points(X, source)
    target[2] = np.nan

    np.testing.assert_allclose(kabsch(source, target, np.array([1.0, 1, 0, 1, 1])), X, atol=1e-12)


def test_many_fits_at_once_equal_one_by_one():
    rng = np.random.default_rng(4)
    source, target = rng.normal(size=(2, 6, 5, 3))

    X = kabsch(source, target)

    for k in range(6):
        np.testing.assert_allclose(X[k], kabsch(source[k], target[k]), atol=1e-12)


def inliers_of(source, target, weights=None):
    weights = np.ones(len(source)) if weights is None else weights
    return rigid_inliers(source, target, weights, DISTANCE)


def moved(rng, count):
    source = rng.normal(scale=0.03, size=(count, 3))
    X = make_transform(rotation_exp(2.0 * rng.normal(size=3)), rng.normal(size=3))
    return source, transform_points(X, source)


@given(st.integers(0, 2**32 - 1))
@settings(derandomize=True, max_examples=50)
def test_rigid_motion_by_any_angle_has_no_outliers(seed):
    rng = np.random.default_rng(seed)
    source, target = moved(rng, 10)

    assert inliers_of(source, target + rng.normal(scale=1e-3, size=(10, 3))).all()


@pytest.mark.parametrize("count", [10, 24])
def test_points_that_moved_elsewhere_are_outliers(count):
    rng = np.random.default_rng(0)
    source, target = moved(rng, count)
    target[[2, 5, 6]] += [[0.02, 0, 0], [0, -0.05, 0], [0, 0.1, 0.1]]

    inliers = inliers_of(source, target, np.ones(count))

    np.testing.assert_array_equal(inliers, ~np.isin(np.arange(count), [2, 5, 6]))


def test_one_of_four_points_can_be_an_outlier():
    source = np.array([[0.0, 0, 0], [0.03, 0, 0], [0, 0.03, 0], [0, 0, 0.03]])
    target = source.copy()
    target[2] += [0.0, 0.02, 0.0]

    assert inliers_of(source, target, np.ones(4)).tolist() == [True, True, False, True]


def test_point_that_keeps_its_distances_can_still_be_an_outlier():
    # Two centimetres sideways, ten away from all others.
    source = np.random.default_rng(0).uniform(-0.02, 0.02, (60, 3))
    source[4] = [0.1, 0.0, 0.0]
    target = source.copy()
    target[4, 1] += 0.02
    before, after = (np.linalg.norm(x - x[4], axis=1) for x in (source, target))
    assert np.mean(np.abs(after - before) < DISTANCE) > 0.8

    inliers = inliers_of(source, target)

    assert inliers.tolist() == [i != 4 for i in range(60)]


def test_inlier_may_change_its_distances_to_the_others():
    # Drawn so that the tip, 4.5 mm off, is 5 mm farther from half of the others.
    plate = [[x, y, 0.0] for x in (-0.03, 0.03) for y in (-0.03, 0.0, 0.03)]
    source = np.array([*plate, [0.0, 0.0, 0.2], [0.05, 0.0, -0.05]])
    target = source.copy()
    target[:6] += np.random.default_rng(43).normal(scale=0.0015, size=(6, 3))
    target[6:] += [[0.0, 0.0, 0.0045], [0.1, 0.0, 0.0]]
    before, after = (np.linalg.norm(x - x[6], axis=1) for x in (source, target))
    assert np.count_nonzero(np.abs(after - before) > DISTANCE) == 4

    assert inliers_of(source, target).tolist() == 7 * [True] + [False]


def test_outlier_that_keeps_its_distances_does_not_exclude_others():
    # Drawn so that the best motion of all but the 7th would leave others more than 5 mm off.
    rng = np.random.default_rng(144)
    source = rng.normal(scale=0.03, size=(10, 3))
    target = source.copy()
    target[[2, 7]] += rng.normal(size=(2, 3)) * [[0.007], [0.1]]

    inliers = inliers_of(source, target)

    assert inliers.tolist() == [i not in (2, 7) for i in range(10)]


def test_points_that_agree_with_several_groups_get_one_of_them():
    # Points on an axis about which three groups turn by different angles.
    group = np.array([[0.08, 0.0, 0.0], [0.09, 0.01, 0.02], [0.08, -0.01, 0.04]])
    axis = np.array([[0.0, 0.0, z] for z in (-0.03, 0.0, 0.05)])
    thirds = rotation_exp(np.radians([0.0, 0.0, 120.0]) * np.arange(3.0)[:, None])
    turns = rotation_exp(np.radians([0.0, 0.0, 25.0]) * np.array([0.4, 2.0, 3.6])[:, None])
    source = np.concatenate([axis, *(group @ R.T for R in thirds)])
    target = np.concatenate(
        [axis, *(group @ (T @ R).T for T, R in zip(turns, thirds, strict=True))]
    )

    inliers = inliers_of(source, target)

    assert inliers[:3].all()
    assert sorted(inliers[3:].reshape(3, 3).sum(axis=1).tolist()) == [0, 0, 3]


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(("heavier", "low"), [(slice(0, 4), 0.05), (slice(4, 10), 0.5)])
def test_heavier_of_two_groups_is_chosen(heavier, low):
    source = np.random.default_rng(0).normal(scale=0.03, size=(10, 3))
    target = source.copy()
    target[4:] = 0.1 - source[4:, [1, 0, 2]]

    weights = np.full(10, low)
    weights[heavier] = 1.0

    inliers = inliers_of(source, target, weights)

    np.testing.assert_array_equal(inliers, weights == 1.0)


def test_inliers_are_those_within_the_distance():
    # One is far off, so that no motion explains all; one is within 5 mm, one outside.
    source = np.random.default_rng(0).normal(scale=0.03, size=(10, 3))
    target = source.copy()
    target[[1, 4, 7], 2] += [0.1, 0.0045, 0.009]

    inliers = inliers_of(source, target)

    assert inliers.tolist() == [i not in (1, 7) for i in range(10)]


def test_without_large_residuals_all_points_are_inliers():
    # Drawn so that the motion leaves 4.3 mm at most, but the best triple leaves some point above 5.
    rng = np.random.default_rng(0)
    target = rng.normal(scale=0.03, size=(10, 3))
    source = target + rng.normal(scale=0.002, size=(10, 3))

    assert inliers_of(source, target).all()


def test_best_motion_of_all_is_weighted():
    # 5.5 mm off: 4.6 if all six points share it, 5.4 if the others hardly do.
    source = 0.03 * np.concatenate([np.eye(3), -np.eye(3)])
    target = source.copy()
    target[2, 2] += 0.0055

    alike = inliers_of(source, target)
    weighted = inliers_of(source, target, np.array([1.0, 1.0, 0.05, 1.0, 1.0, 1.0]))

    assert alike.all()
    assert weighted.tolist() == [i != 2 for i in range(6)]


def test_motion_that_adds_others_is_weighted():
    # Drawn so that the best three points' motion leaves one out, and so does the fit without
    # weights to its inliers.
    rng = np.random.default_rng(31)
    target = rng.normal(scale=0.03, size=(10, 3))
    source = target + rng.normal(scale=0.002, size=(10, 3))
    source[[1, 4]] += [[0.05, 0.0, 0.0], [0.0, -0.06, 0.0]]

    inliers = inliers_of(source, target, np.linspace(0.3, 1.0, 10))

    assert inliers.tolist() == [i not in (1, 4) for i in range(10)]


@pytest.mark.filterwarnings("error")
def test_coincident_targets_propose_nothing():
    source = 0.03 * np.concatenate([np.eye(3), -np.eye(3)])
    target = source.copy()
    target[1] = target[0]

    assert inliers_of(source, target, np.ones(6)).tolist() == [i != 1 for i in range(6)]


def test_three_or_collinear_points_have_no_outliers():
    line = np.linspace(0.0, 1.0, 6)[:, None] * np.array([1.0, 0, 0])
    bent = line + np.random.default_rng(1).normal(size=(6, 3))

    assert inliers_of(np.eye(3), 2.0 * np.eye(3)).all()
    assert inliers_of(line, bent).all()


def test_every_set_of_few_points_is_tried():
    # No three corners of a regular pentagon form a thin triangle.
    angles = 0.4 * np.pi * np.arange(5)
    points = np.stack([np.cos(angles), np.sin(angles), 0.0 * angles], axis=1)

    triples = choose_triples(points)

    assert {tuple(t) for t in triples.tolist()} == set(combinations(range(5), 3))


def test_sets_of_many_points_are_random_but_reproducible():
    points = np.random.default_rng(1).normal(size=(30, 3))

    first = choose_triples(points)
    rigid_fit._triples.cache_clear()

    np.testing.assert_array_equal(choose_triples(points), first)
    assert 150 < len(first) <= 200
    assert len({tuple(sorted(t)) for t in first.tolist()}) > 150
    assert all(len(set(t)) == 3 for t in first.tolist())


def test_thin_triangles_are_skipped():
    # Height over longest side: 0.05 / 2 of the first three, 0 of the three on the x axis.
    points = np.array([[-1.0, 0, 0], [0, 0.05, 0], [1, 0, 0], [0, 0, 0], [0, 1, 0]])

    triples = choose_triples(points).tolist()

    assert [0, 1, 2] not in triples
    assert [0, 2, 3] not in triples
    assert [0, 2, 4] in triples


def test_two_points_make_no_triple():
    assert choose_triples(np.eye(3)[:2]).shape == (0, 3)
