import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from poil_drake.errors import TransferError
from poil_drake.transfer.demonstration_tracks import DemonstrationTracks
from poil_drake.transfer.matching import make_matching_reference, transferred_positions

POINTS = np.array([[0.0, 0.0, 0.0], [0.03, 0.0, 0.01], [0.0, 0.05, 0.0], [0.01, 0.01, 0.04]])


def moving(points: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Returns points (T, N, 3) that turn about z and rise, both smoothly."""
    share = (1.0 - np.cos(np.pi * np.clip(times / 3.0, 0.0, 1.0))) / 2.0
    R = Rotation.from_rotvec(1.2 * share[:, None] * [0.0, 0.0, 1.0]).as_matrix()
    return points @ np.swapaxes(R, 1, 2) + 0.2 * share[:, None, None] * [0.0, 0.0, 1.0]


def tracks(confidence: np.ndarray | None = None) -> DemonstrationTracks:
    times = np.arange(0.0, 4.0, 0.125)
    positions = moving(POINTS, times)
    weights = np.ones(positions.shape[:2]) if confidence is None else confidence
    return DemonstrationTracks(times, np.where(weights[..., None] > 0, positions, np.nan), weights)


def test_a_rigid_copy_follows_exactly() -> None:
    # The copy's own motion is the closed form.
    R = Rotation.from_rotvec([0.4, -1.0, 0.3]).as_matrix()
    target = POINTS @ R.T + [0.5, 0.1, 0.0]

    dut = transferred_positions(target, tracks())

    np.testing.assert_allclose(dut, tracks().positions, atol=1e-12)


def test_each_alignment_agrees_with_scipy() -> None:
    target = POINTS * [1.1, 0.9, 1.2] + [0.3, 0.0, 0.0]
    demonstrated = tracks()

    dut = transferred_positions(target, demonstrated)

    arms = target - target.mean(axis=0)
    for k, configuration in enumerate(demonstrated.positions):
        center = configuration.mean(axis=0)
        R, _ = Rotation.align_vectors(configuration - center, arms)
        np.testing.assert_allclose(dut[k], R.apply(arms) + center, atol=1e-9)


def test_points_without_confidence_do_not_count() -> None:
    confidence = np.ones((32, 4))
    confidence[7, 3] = 0.0  # Three points are left, which are enough.
    confidence[5, :2] = 0.0  # Two points are not.
    expected = tracks().positions.copy()
    expected[5] = np.nan

    dut = transferred_positions(POINTS, tracks(confidence))

    np.testing.assert_allclose(dut, expected, atol=1e-12)


def test_points_can_be_posed_by_others() -> None:
    above = np.array([0.0, 0.0, 0.01])

    dut = transferred_positions(POINTS + above, tracks(), posed_by=POINTS)

    np.testing.assert_allclose(dut, tracks().positions + above, atol=1e-12)


def test_the_reference_ends_where_the_demonstration_does() -> None:
    target = POINTS + np.array([0.4, 0.0, 0.0])

    reference = make_matching_reference(target, tracks())

    np.testing.assert_allclose(
        reference.positions[-1], moving(POINTS, np.array([9.0]))[0], atol=1e-3
    )
    np.testing.assert_array_equal(reference.velocities[-1], 0.0)


def test_rejects_a_demonstration_without_tracks() -> None:
    confidence = np.zeros((32, 4))
    confidence[0] = 1.0

    with pytest.raises(TransferError, match="1 of 32 frames"):
        make_matching_reference(POINTS, tracks(confidence))
