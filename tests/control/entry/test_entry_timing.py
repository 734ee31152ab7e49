import numpy as np
import pytest
from entry_scenes import at, demonstration
from numpy.testing import assert_allclose

from poil_drake.control.entry.entry_timing import ACCELERATION, SPEED, extended_reference
from poil_drake.control.field.twist_fit import fit_twist
from poil_drake.control.reference.pose_smoothing import interpolate_poses
from poil_drake.geometry.rigid_transform import inverse, transform_points

POINTS = 0.03 * np.array([[1.0, 0, 0], [-1, 0.2, 0], [0, 1.5, 0], [0, -1.5, 0.3], [0, 0, 2]])
SAMPLE = 12


@pytest.fixture(scope="module")
def reference():
    return demonstration(POINTS, [at(0, 0, 0.2), at(0.3, 0.1, 0.2, 0.5), at(0.3, 0.1, 0.1, 0.5)])


@pytest.fixture(scope="module")
def transit():
    """Poses that end where the reference's shape at `SAMPLE` stays as it is."""
    corners = np.array([at(-0.3, 0.2, 0.1, 2.0), at(-0.3, 0.0, 0.3, 1.0), np.eye(4)])
    return interpolate_poses(np.arange(3.0), corners, np.linspace(0.0, 2.0, 101))


@pytest.fixture(scope="module")
def dut(reference, transit):
    return extended_reference(reference, transit, SAMPLE)


def test_it_begins_at_the_start_and_continues_as_the_demonstration(reference, transit, dut):
    shape = reference.positions[SAMPLE]
    tail = len(reference.times) - SAMPLE
    assert_allclose(
        dut.positions[0], transform_points(transit[0] @ inverse(transit[-1]), shape), atol=1e-12
    )
    assert_allclose(dut.positions[-tail:], reference.positions[SAMPLE:], atol=1e-15)
    assert_allclose(dut.velocities[-tail:], reference.velocities[SAMPLE:], atol=1e-15)
    assert_allclose(np.diff(dut.times[-tail:]), np.diff(reference.times[SAMPLE:]), atol=1e-12)


def test_shape_stays_rigid(dut):
    sides = np.linalg.norm(dut.positions[:, :, None] - dut.positions[:, None], axis=-1)
    assert_allclose(sides, np.broadcast_to(sides[-1], sides.shape), atol=1e-9)


def test_velocities_are_rigid_motions_that_match_the_positions(reference, dut):
    joint = len(dut.times) - len(reference.times) + SAMPLE
    for k in range(1, joint):
        points, velocities = dut.positions[k], dut.velocities[k]
        fit = fit_twist(points, velocities, np.full(len(points), 1.0 / len(points)))
        assert fit.squared_errors(points, velocities).max() < 1e-20
        span = dut.times[k + 1] - dut.times[k - 1]
        moved = (dut.positions[k + 1] - dut.positions[k - 1]).mean(axis=0) / span
        assert_allclose(fit.v, moved, atol=1e-9)


def test_speeds_are_within_the_limits_and_zero_only_at_the_end(reference, dut):
    speeds = np.sqrt(np.mean(np.sum(dut.velocities**2, axis=2), axis=1))
    joint = len(dut.times) - len(reference.times) + SAMPLE
    assert np.all(speeds[:joint] <= 1.01 * SPEED)
    assert np.all(speeds[:-1] > 0.005)
    assert np.all(dut.velocities[-1] == 0.0)


def test_a_straight_transit_accelerates_within_the_limit(reference):
    transit = np.array([at(x, 0.0, 0.0) for x in np.linspace(0.4, 0.0, 41)])

    dut = extended_reference(reference, transit, SAMPLE)

    speeds = np.linalg.norm(dut.velocities.mean(axis=1), axis=1)
    joint = len(dut.times) - len(reference.times) + SAMPLE
    assert speeds.max() == pytest.approx(SPEED, rel=0.01)
    steps = np.abs(np.diff(speeds[:joint])) / dut.times[1]
    # Central differences see the start of the motion within one step.
    assert steps.max() <= 1.25 * ACCELERATION
    # It arrives with the speed of the demonstration.
    assert speeds[joint - 1] == pytest.approx(speeds[joint], abs=0.02)


def test_a_turn_on_the_spot_is_limited_by_the_angular_speed(reference):
    centre = reference.positions[SAMPLE].mean(axis=0)
    there, back = at(*centre), at(*-centre)
    turn = np.array([there @ at(0, 0, 0, angle) @ back for angle in np.linspace(3.0, 0.0, 61)])

    dut = extended_reference(reference, turn, SAMPLE)

    joint = len(dut.times) - len(reference.times) + SAMPLE
    # 3 rad at 1 rad/s, and the time to accelerate and to slow down to the reference's speed.
    assert 3.0 < dut.times[joint] < 4.0


def test_a_transit_to_the_end_of_the_demonstration_stops(reference, transit):
    dut = extended_reference(reference, transit, len(reference.times) - 1)

    assert_allclose(dut.positions[-1], reference.positions[-1], atol=1e-12)
    assert np.all(dut.velocities[-1] == 0.0)
    assert np.linalg.norm(dut.velocities[-3]) < 0.1


@pytest.mark.parametrize("sample", [SAMPLE, -1])
def test_a_transit_of_no_length_leaves_the_rest_of_the_demonstration(reference, sample):
    sample %= len(reference.times)

    dut = extended_reference(reference, np.eye(4)[None], sample)

    assert_allclose(dut.positions[-1], reference.positions[-1])
    assert dut.times[0] == 0.0
