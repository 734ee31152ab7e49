import numpy as np
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation, Slerp

from poil_drake.geometry.rigid_transform import make_transform, transform_points
from poil_drake.planning.pose_vectors import poses_of, same_side, vectors_of

RADIUS = 0.1


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
