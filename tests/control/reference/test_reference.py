import numpy as np
import pytest

from poil_drake.control.field.point_set_bcsdm import BcsdmConfig
from poil_drake.control.field.rollout import rollout
from poil_drake.control.reference.make_reference import make_reference as dut
from poil_drake.control.reference.make_reference import reference_from_samples
from poil_drake.control.reference.timing import ReferenceConfig, RetimingConfig
from poil_drake.errors import InvalidValueError, TransferError
from poil_drake.geometry.rigid_fit import kabsch
from poil_drake.geometry.rigid_transform import make_transform, rotation_exp, transform_points

BODY = np.random.default_rng(7).normal(size=(10, 3)) * [0.02, 0.015, 0.008]
# When, where and turned how: standing, lifting, a pause, over to the side, down to the goal.
VIA = [
    (0.0, [0.45, -0.10, 0.05], [0.0, 0.0, 0.0]),
    (1.5, [0.45, -0.10, 0.05], [0.0, 0.0, 0.0]),
    (4.0, [0.45, 0.00, 0.30], [0.0, 0.4, 0.3]),
    (5.5, [0.45, 0.00, 0.30], [0.0, 0.4, 0.3]),
    (8.0, [0.50, 0.20, 0.30], [0.0, 0.8, 1.2]),
    (9.5, [0.50, 0.27, 0.27], [0.0, 0.8, 1.2]),
    (12.0, [0.50, 0.27, 0.27], [0.0, 0.8, 1.2]),
]


def demonstration(noise=0.0, rate=8.0, seed=0):
    """Times (T,) and positions (T, 10, 3) of the body, with noise on every coordinate."""
    times = np.arange(0.0, 12.0, 1.0 / rate)
    poses = []
    for t in times:
        k = max(i for i, via in enumerate(VIA[:-1]) if via[0] <= t)
        (t0, p0, w0), (t1, p1, w1) = VIA[k : k + 2]
        u = (t - t0) / (t1 - t0)
        s = u**3 * (10.0 - 15.0 * u + 6.0 * u**2)
        w = (1.0 - s) * np.array(w0) + s * np.array(w1)
        poses.append(make_transform(rotation_exp(w), (1.0 - s) * np.array(p0) + s * np.array(p1)))
    positions = transform_points(np.array(poses), BODY)
    return times, positions + noise * np.random.default_rng(seed).normal(size=positions.shape)


def goal():
    return transform_points(make_transform(rotation_exp(VIA[-1][2]), VIA[-1][1]), BODY)


def rms(vectors):
    """Root mean square length (...) over N points (..., N, 3)."""
    return np.sqrt(np.mean(np.sum(vectors**2, axis=-1), axis=-1))


@pytest.fixture(scope="module")
def reference():
    return dut(*demonstration(noise=1e-3))


def largest_deviation(reference):
    """Largest distance from the demonstrated path [m]."""
    _, path = demonstration(rate=128.0)
    return max(np.min(rms(path - sample)) for sample in reference.positions)


def test_reference_starts_and_ends_at_the_mean_poses_at_rest(reference):
    start = BODY + np.array(VIA[0][1])

    assert rms(reference.positions[0] - start) < 0.7e-3
    # Of 2.5 s at rest 2 s count, 16 samples with 1 mm of noise on each of 10 points.
    assert rms(reference.positions[-1] - goal()) < 0.5e-3


def test_reference_stays_on_the_demonstrated_path(reference):
    exact = dut(*demonstration())

    assert largest_deviation(reference) < 1.5e-3
    assert largest_deviation(exact) < 1.0e-3
    assert rms(exact.positions[-1] - goal()) < 1e-9


def test_every_sample_is_the_same_rigid_shape(reference):
    shape = reference.positions[0]
    X = kabsch(np.broadcast_to(shape, reference.positions.shape), reference.positions)

    np.testing.assert_allclose(transform_points(X, shape), reference.positions, atol=1e-12)


def test_velocities_are_the_rate_of_the_positions(reference):
    # The differences are those of a smooth motion: over 1/32 s its curvature shows by 2 mm/s.
    rates = np.gradient(reference.positions, reference.times, axis=0)

    np.testing.assert_allclose(reference.velocities[1:-1], rates[1:-1], atol=2e-3)
    assert not reference.velocities[-1].any()


def test_only_the_last_sample_is_at_rest(reference):
    speeds = rms(reference.velocities)
    slowing = reference.times > reference.times[-1] - 0.5

    # The lower limit is 0.02 m/s; where the path turns at the pause, differences cut the corner.
    assert np.min(speeds[~slowing]) > 0.01
    assert np.all(np.diff(speeds[-8:]) < 0.0)


def test_pauses_are_cut_and_samples_are_even(reference):
    # 6.5 s of 12 are motion; 0.5 s more allow for coming to rest.
    assert 4.5 < reference.times[-1] < 7.0
    np.testing.assert_allclose(np.diff(reference.times), 1.0 / 32.0, rtol=1e-12)


def test_controller_follows_the_reference_through_the_pause_to_the_end(reference):
    run = rollout(reference.positions[0], reference, BcsdmConfig(), 1.0 / 64.0, 20.0)

    assert run.converged
    assert run.times[-1] < reference.times[-1] + 1.0


def test_same_input_gives_the_same_bits(reference):
    again = dut(*demonstration(noise=1e-3))

    np.testing.assert_array_equal(again.positions, reference.positions)
    np.testing.assert_array_equal(again.velocities, reference.velocities)


def test_speed_can_be_scaled():
    slow = ReferenceConfig(retiming=RetimingConfig(speed_scale=0.5))

    ratio = dut(*demonstration(), slow).times[-1] / dut(*demonstration()).times[-1]

    # Less than 2, because the slowest stretches are at the lower limit in both.
    assert 1.6 < ratio < 2.0


def test_unobserved_points_and_samples_are_bridged():
    times, positions = demonstration(noise=1e-3)
    positions[30, :4] = np.nan
    positions[40:43] = np.nan
    positions[60, 3:] = np.nan

    reference = dut(times, positions)

    assert rms(reference.positions[-1] - goal()) < 0.5e-3
    assert largest_deviation(reference) < 3e-3


def test_outliers_do_not_count():
    times, positions = demonstration(noise=1e-3)
    positions[70:, 2] += [0.0, 0.04, 0.0]
    positions[85, 5:8] += [0.03, 0.0, 0.05]

    reference = dut(times, positions)

    assert rms(reference.positions[-1] - goal()) < 0.7e-3


def test_recording_that_ends_in_motion_is_followed_to_its_last_sample():
    times, positions = demonstration()
    kept = times <= 7.0

    reference = dut(times[kept], positions[kept])

    assert rms(reference.positions[-1] - positions[kept][-1]) < 2e-3
    assert not reference.velocities[-1].any()


def test_noise_alone_is_not_motion():
    for seed in range(5):
        noise = 1e-3 * np.random.default_rng(seed).normal(size=(96, 10, 3))
        with pytest.raises(TransferError, match="Nothing moves"):
            dut(np.arange(96) / 8.0, BODY + noise)


def test_invalid_input_is_rejected():
    times, positions = demonstration()
    too_few = positions.copy()
    too_few[3:] = np.nan

    with pytest.raises(TransferError, match="3 have three points"):
        dut(times, too_few)
    with pytest.raises(TransferError, match="increase"):
        dut(times[::-1], positions)
    with pytest.raises(InvalidValueError, match=r"\(5, 3\)"):
        dut(np.arange(5.0), np.zeros((5, 3)))
    with pytest.raises(InvalidValueError, match="sample_period"):
        ReferenceConfig(sample_period=0.0)


# References that keep the points as they were recorded.

TETRAHEDRON = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1]])


def stretching(rest=16):
    """Rests, moves along x by 0.2 m in 2 s while it is stretched along y, and rests."""
    share = np.concatenate([np.zeros(rest), np.linspace(0.0, 1.0, 33), np.ones(rest)])
    positions = TETRAHEDRON * (1.0 + share[:, None, None] * [0.0, 0.2, 0.0])
    positions = positions + share[:, None, None] * np.array([0.2, 0.0, 0.0])
    return np.arange(len(share)) / 16, positions


def test_deformation_is_kept():
    times, positions = stretching()

    reference = reference_from_samples(times, positions)

    np.testing.assert_allclose(reference.positions[-1], positions[-1])
    middle = reference.positions_at(reference.times[-1] / 2)
    assert middle[2, 1] == pytest.approx(0.11, abs=0.002)


def test_rest_before_and_after_is_cut():
    reference = reference_from_samples(*stretching(rest=40))

    assert reference.times[-1] == pytest.approx(2.0, abs=0.2)


def test_velocities_are_those_of_the_motion_and_zero_at_the_end():
    reference = reference_from_samples(*stretching())

    k = len(reference.times) // 2
    np.testing.assert_allclose(reference.velocities[k, 0], [0.1, 0.0, 0.0], atol=1e-3)
    assert not reference.velocities[-1].any()


def test_sample_period_can_be_set():
    reference = reference_from_samples(*stretching(), ReferenceConfig(sample_period=0.01))

    np.testing.assert_allclose(np.diff(reference.times), 0.01, rtol=0.05)


def test_unobserved_points_are_rejected():
    times, positions = stretching()
    positions[3, 2] = np.nan

    with pytest.raises(InvalidValueError, match="positions"):
        reference_from_samples(times, positions)
