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


def test_a_pose_goes_there_and_back():
    X = random_poses(200)

    assert_allclose(poses_of(vectors_of(X, RADIUS)), X, atol=1e-12)


def test_half_turns_go_there_and_back():
    X = make_transform(
        np.array([np.diag([1.0, -1, -1]), np.diag([-1.0, 1, -1]), np.diag([-1.0, -1, 1])]),
        np.zeros((3, 3)),
    )

    assert_allclose(poses_of(vectors_of(X, RADIUS)), X, atol=1e-12)


def test_the_quaternion_is_the_one_of_scipy():
    X = random_poses(50)

    quaternions = vectors_of(X, RADIUS)[:, 3:] / (2.0 * RADIUS)

    expected = Rotation.from_matrix(X[:, :3, :3]).as_quat(scalar_first=True)
    assert_allclose(np.abs(np.sum(quaternions * expected, axis=1)), 1.0, atol=1e-12)


def test_the_middle_of_a_line_is_half_of_the_turn():
    X = random_poses(2, seed=4)

    first, last = vectors_of(X, RADIUS)
    middle = poses_of(0.5 * (first + last)[None])[0]

    halfway = Slerp([0.0, 1.0], Rotation.from_matrix(X[:, :3, :3]))(0.5).as_matrix()
    assert_allclose(middle[:3, :3], halfway, atol=1e-12)
    assert_allclose(middle[:3, 3], X[:, :3, 3].mean(axis=0), atol=1e-12)


def test_points_of_the_body_move_by_less_than_the_square_root_of_two_times_the_distance():
    # Small steps, as between two checks of an edge.
    rng = np.random.default_rng(5)
    body = rng.normal(size=(300, 3))
    body *= RADIUS / np.linalg.norm(body, axis=1)[:, None]
    for k in range(50):
        X = random_poses(1, seed=k)
        step = rng.normal(size=7) * [0.004, 0.004, 0.004, 0.008, 0.008, 0.008, 0.008]
        first = vectors_of(X, RADIUS)[0]
        last = vectors_of(poses_of((first + step)[None]), RADIUS)[0]
        first, last = same_side(np.stack([first, last]))

        moved = transform_points(poses_of(np.stack([first, last])), body)

        farthest = np.linalg.norm(moved[1] - moved[0], axis=1).max()
        assert farthest <= 1.01 * np.sqrt(2.0) * np.linalg.norm(last - first)


def test_points_of_the_body_move_by_less_than_the_square_root_of_three_times_a_step_of_an_edge():
    rng = np.random.default_rng(6)
    body = rng.normal(size=(300, 3))
    body *= RADIUS / np.linalg.norm(body, axis=1)[:, None]
    largest = 0.0
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


def test_neighbours_come_to_the_same_side():
    vectors = vectors_of(random_poses(20), RADIUS)
    vectors[::3, 3:] *= -1.0

    sided = same_side(vectors)

    assert np.all(np.einsum("bi,bi->b", sided[1:, 3:], sided[:-1, 3:]) >= 0.0)
    assert_allclose(poses_of(sided), poses_of(vectors), atol=1e-12)
