from itertools import pairwise

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation, Slerp

from poil_drake.geometry.rigid_transform import make_transform, transform_points
from poil_drake.planning.path_shortening import EdgeChecker
from poil_drake.planning.rrt_connect import (
    VectorSpace,
    poses_of,
    rrt_connect,
    same_side,
    vectors_of,
)

START, GOAL = np.array([-0.5, 0.0]), np.array([0.5, 0.0])
RADIUS = 0.1


def beside_the_wall(x):
    """A wall at x = 0 with a gap above y = 0.5."""
    return (np.abs(x[:, 0]) > 0.05) | (x[:, 1] > 0.5)


def closed(x):
    return np.abs(x[:, 0]) > 0.05


def search(is_free, seed=0, iterations=2000):
    return rrt_connect(
        VectorSpace(np.array([-1.0, -1.0]), np.array([1.0, 1.0])),
        START,
        GOAL,
        is_free=is_free,
        edge_is_free=EdgeChecker(is_free, 0.02).is_free,
        max_edge=0.4,
        iterations=iterations,
        seed=seed,
    )


@pytest.mark.parametrize("seed", range(5))
def test_path_leads_through_the_gap(seed):
    corners = search(beside_the_wall, seed)

    assert_allclose(corners[[0, -1]], [START, GOAL], atol=1e-12)
    edges = EdgeChecker(beside_the_wall, 0.002)
    assert all(edges.is_free(a, b) for a, b in pairwise(corners))
    assert np.linalg.norm(np.diff(corners, axis=0), axis=1).max() <= 0.4 + 1e-9


def test_earlier_searches_do_not_matter():
    first = search(beside_the_wall, seed=3)
    other = search(beside_the_wall, seed=4)
    for seed in range(5):
        search(closed, seed, iterations=50)

    assert_array_equal(search(beside_the_wall, seed=3), first)
    assert not np.array_equal(first, other)


def test_search_without_a_path_ends():
    assert search(closed, iterations=100) is None


def random_poses(count, seed=0):
    rng = np.random.default_rng(seed)
    turns = Rotation.random(count, random_state=seed).as_matrix()
    return make_transform(turns, rng.uniform(-1.0, 1.0, (count, 3)))


def random_sphere(seed):
    points = np.random.default_rng(seed).normal(size=(300, 3))
    return RADIUS * points / np.linalg.norm(points, axis=1)[:, None]


def test_poses_are_recovered_from_their_vectors():
    half_turns = np.array([np.diag([1.0, -1, -1]), np.diag([-1.0, 1, -1]), np.diag([-1.0, -1, 1])])
    X = np.concatenate([random_poses(200), make_transform(half_turns, np.zeros((3, 3)))])

    vectors = vectors_of(X, RADIUS)

    assert_allclose(poses_of(vectors), X, atol=1e-12)
    expected = Rotation.from_matrix(X[:, :3, :3]).as_quat(scalar_first=True)
    products = np.sum(vectors[:, 3:] * expected, axis=1)
    assert_allclose(np.abs(products), 2.0 * RADIUS, atol=1e-12)


def test_the_middle_of_a_line_is_the_halfway_pose():
    X = random_poses(2, seed=4)

    first, last = vectors_of(X, RADIUS)
    middle = poses_of(0.5 * (first + last)[None])[0]

    halfway = Slerp([0.0, 1.0], Rotation.from_matrix(X[:, :3, :3]))(0.5).as_matrix()
    assert_allclose(middle[:3, :3], halfway, atol=1e-12)
    assert_allclose(middle[:3, 3], X[:, :3, 3].mean(axis=0), atol=1e-12)


def test_points_move_by_less_than_the_square_root_of_two_times_a_small_distance():
    rng, body = np.random.default_rng(5), random_sphere(5)
    for k in range(50):
        X = random_poses(1, seed=k)
        step = rng.normal(size=7) * [0.004, 0.004, 0.004, 0.008, 0.008, 0.008, 0.008]
        first = vectors_of(X, RADIUS)[0]
        last = vectors_of(poses_of((first + step)[None]), RADIUS)[0]
        first, last = same_side(np.stack([first, last]))

        moved = transform_points(poses_of(np.stack([first, last])), body)

        farthest = np.linalg.norm(moved[1] - moved[0], axis=1).max()
        assert farthest <= 1.01 * np.sqrt(2.0) * np.linalg.norm(last - first)


def test_points_move_by_less_than_the_square_root_of_three_times_a_step_of_an_edge():
    largest, body = 0.0, random_sphere(6)
    for k in range(50):
        first, last = same_side(vectors_of(random_poses(2, seed=k), RADIUS))
        if k == 0:  # A half turn, which cuts deepest, across the shift.
            X = make_transform(np.stack([np.eye(3), np.diag([-1.0, -1, 1])]), np.zeros((2, 3)))
            X[1, 2, 3] = 0.2
            first, last = same_side(vectors_of(X, RADIUS))
        steps = np.linspace(0.0, 1.0, 301)[:, None]
        poses = poses_of((1.0 - steps) * first + steps * last)
        moved = np.linalg.norm(np.diff(transform_points(poses, body), axis=0), axis=2).max()
        largest = max(largest, moved / (np.linalg.norm(last - first) / 300))

    assert np.sqrt(2.0) < largest <= 1.001 * np.sqrt(3.0)


def test_successive_quaternions_get_the_same_side():
    vectors = vectors_of(random_poses(20), RADIUS)
    vectors[::3, 3:] *= -1.0

    sided = same_side(vectors)

    assert np.all(np.einsum("bi,bi->b", sided[1:, 3:], sided[:-1, 3:]) >= 0.0)
    assert_allclose(poses_of(sided), poses_of(vectors), atol=1e-12)
