"""BCSDM on poses against its formulas, written out with matrices by SciPy, and against PyTorch."""

import numpy as np
import pytest
import torch
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from poil_drake.benchmarks.control.policies.policy import Observation
from poil_drake.benchmarks.control.policies.se3_bcsdm import (
    PoseTrajectory,
    Se3BcsdmConfig,
    Se3BcsdmPolicy,
    closest_pose,
    se3_bcsdm,
)
from poil_drake.benchmarks.latency.se3_bcsdm_torch import TorchSe3Bcsdm
from poil_drake.geometry.rigid_transform import make_transform, skew

CONFIG = Se3BcsdmConfig(rotation_gain=2.0, position_gain=3.0)


def pose(rotation_vector: object, position: object) -> np.ndarray:
    return make_transform(Rotation.from_rotvec(rotation_vector).as_matrix(), position)


@pytest.fixture(scope="module")
def reference() -> PoseTrajectory:
    """A turn of 120 degrees about a tilted axis along a bent path, in 4 s."""
    times = np.linspace(0.0, 4.0, 201)
    s = times / 4.0
    axis = np.array([0.3, -0.5, 0.8]) / np.linalg.norm([0.3, -0.5, 0.8])
    poses = [pose(2.0 * u * axis, [0.3 * u, 0.1 * np.sin(3.0 * u), 0.2 * u * u]) for u in s]
    return PoseTrajectory.of(times, np.array(poses))


def random_poses(count: int, seed: int = 0) -> np.ndarray:
    random = np.random.default_rng(seed)
    R = Rotation.random(count, rng=random).as_matrix()
    return make_transform(R, random.uniform(-0.3, 0.3, (count, 3)))


def log(R: np.ndarray) -> np.ndarray:
    return skew(Rotation.from_matrix(R).as_rotvec())


def test_velocities_are_forward_differences_and_end_at_rest() -> None:
    # A quarter turn about z in 0.5 s while moving 0.1 m along y, then 0.2 m along x in 1 s.
    turned = [0.0, 0.0, np.pi / 2]
    X = np.array(
        [pose([0, 0, 0], [0, 0, 0]), pose(turned, [0, 0.1, 0]), pose(turned, [0.2, 0.1, 0])]
    )

    dut = PoseTrajectory.of(np.array([0.0, 0.5, 1.5]), X)

    np.testing.assert_allclose(dut.omegas, [[0, 0, np.pi], [0, 0, 0], [0, 0, 0]], atol=1e-12)
    np.testing.assert_allclose(dut.velocities, [[0, 0.2, 0], [0.2, 0, 0], [0, 0, 0]], atol=1e-12)


def test_closest_sample_minimises_the_metric(reference: PoseTrajectory) -> None:
    for X_WO in random_poses(50):
        R, p = X_WO[:3, :3], X_WO[:3, 3]
        distances = [
            np.linalg.norm(log(R.T @ X[:3, :3])) ** 2 + 100.0 * np.linalg.norm(X[:3, 3] - p) ** 2
            for X in reference.X_WO
        ]

        assert closest_pose(X_WO, reference, CONFIG) == int(np.argmin(distances))


def test_field_on_the_reference_is_the_reference_velocity(reference: PoseTrajectory) -> None:
    for index in (0, 60, 150):
        X_WO = reference.X_WO[index]

        V, closest = se3_bcsdm(X_WO, reference, CONFIG)

        assert closest == index
        np.testing.assert_allclose(V[:3], X_WO[:3, :3] @ reference.omegas[index], atol=1e-9)
        np.testing.assert_allclose(V[3:], reference.velocities[index], atol=1e-12)


def test_field_at_the_end_is_pure_contraction(reference: PoseTrajectory) -> None:
    end = reference.X_WO[-1]
    turn = np.array([0.0, 0.0, 0.2])
    R = Rotation.from_rotvec(turn).as_matrix() @ end[:3, :3]
    beyond = make_transform(R, end[:3, 3] + [0.3, 0.0, 0.4])

    V, closest = se3_bcsdm(beyond, reference, CONFIG)

    assert closest == len(reference.X_WO) - 1
    np.testing.assert_allclose(V[:3], -2.0 * turn, atol=1e-9)
    np.testing.assert_allclose(V[3:], [-0.9, 0.0, -1.2], atol=1e-12)


def test_field_is_the_published_one_written_with_matrices(reference: PoseTrajectory) -> None:
    for X_WO in random_poses(50, seed=1):
        V, index = se3_bcsdm(X_WO, reference, CONFIG)

        R, R_star = X_WO[:3, :3], reference.X_WO[index, :3, :3]
        half = expm(0.5 * log(R_star.T @ R))
        transported = R_star @ half @ skew(reference.omegas[index]) @ half
        expected = transported + 2.0 * R @ log(R.T @ R_star)
        np.testing.assert_allclose(skew(V[:3]) @ R, expected, atol=1e-9)
        v = reference.velocities[index] + 3.0 * (reference.X_WO[index, :3, 3] - X_WO[:3, 3])
        np.testing.assert_allclose(V[3:], v, atol=1e-12)


def test_field_half_a_turn_away_is_finite() -> None:
    reference = PoseTrajectory.of(np.array([0.0, 1.0]), np.tile(np.eye(4), (2, 1, 1)))
    for axis in np.vstack([np.eye(3), -np.eye(3), [[0.6, 0.0, -0.8]]]):
        V, _ = se3_bcsdm(pose(np.pi * axis, [0, 0, 0]), reference, CONFIG)

        # In either direction, at full speed.
        assert np.linalg.norm(V[:3]) == pytest.approx(2.0 * np.pi, abs=1e-6)


def test_pytorch_gives_the_same(reference: PoseTrajectory) -> None:
    poses = random_poses(200, seed=3)
    field = TorchSe3Bcsdm(reference, CONFIG)

    dut = field(torch.tensor(poses)).numpy()

    expected = np.array([se3_bcsdm(X_WO, reference, CONFIG)[0] for X_WO in poses])
    # The textbook logarithm divides by the sine of the angle: it loses digits near half a turn.
    np.testing.assert_allclose(dut, expected, atol=1e-5)


def test_pytorch_is_finite_on_the_reference_and_half_a_turn_away(reference: PoseTrajectory) -> None:
    end = reference.X_WO[-1]
    opposite = end @ pose([np.pi, 0, 0], [0, 0, 0])
    field = TorchSe3Bcsdm(reference, CONFIG)

    assert field(torch.tensor(np.array([end, opposite]))).isfinite().all()


def test_policy_commands_the_field_at_the_origin_of_the_object(reference: PoseTrajectory) -> None:
    dut = Se3BcsdmPolicy(reference, CONFIG)
    X_WO = random_poses(1, seed=4)[0]
    observation = Observation(0.0, np.full((4, 3), np.nan), np.zeros(4), X_WO, np.eye(4))

    _, twist = dut.step(dut.start(), observation)

    np.testing.assert_array_equal(twist.V, se3_bcsdm(X_WO, reference, CONFIG)[0])
    np.testing.assert_array_equal(twist.point, X_WO[:3, 3])
    assert dut.period == 1 / 64
