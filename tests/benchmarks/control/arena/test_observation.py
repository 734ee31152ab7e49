import numpy as np
import pytest
from system_bench import SystemBench

from poil_drake.benchmarks.control.arena.observation import DelayedTracking, TrackingConfig
from poil_drake.geometry.rigid_transform import make_transform, rotation_exp, transform_points

POINTS = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0]])
NOISELESS = TrackingConfig(noise=0.0)
CONTROL = NOISELESS.control_period


def make_bench(config=NOISELESS, seed=0):
    bench = SystemBench(
        DelayedTracking(num_points=3, config=config), points=POINTS, hand_pose=np.eye(4)
    )
    bench.dut.SetSeed(bench.context, seed)
    return bench


def points_at(bench, time):
    bench.advance_to(time)
    return bench.read("points").reshape(-1, 3)


def test_points_are_nan_before_the_first_result():
    bench = make_bench()

    points = points_at(bench, 0.1)

    assert np.isnan(points).all()
    assert not bench.read("confidence").any()


def test_first_result_arrives_after_the_latency():
    bench = make_bench()

    # 0.1 s is 6.4 control periods; the event of the seventh takes place when time has passed it.
    points = points_at(bench, 7.5 * CONTROL)

    np.testing.assert_allclose(points, POINTS)
    assert bench.read("confidence").all()


def test_points_follow_the_hand():
    bench = make_bench()
    bench.advance_to(7.5 * CONTROL)
    X = make_transform(rotation_exp([0.0, 0.0, 0.3]), np.array([0.05, 0.0, 0.02]))

    bench.fix(points=transform_points(X, POINTS), hand_pose=X)
    points = points_at(bench, 8.5 * CONTROL)

    np.testing.assert_allclose(points, transform_points(X, POINTS), atol=1e-12)


def test_slip_shows_with_the_delay_of_the_tracker():
    bench = make_bench()
    bench.advance_to(10.5 * CONTROL)
    slipped = POINTS + np.array([0.03, 0.0, 0.0])

    bench.fix(points=slipped, hand_pose=np.eye(4))
    # The next capture is that of the 16th control period, and released seven later.
    before, after = points_at(bench, 22.5 * CONTROL), points_at(bench, 23.5 * CONTROL)

    np.testing.assert_allclose(before, POINTS)
    np.testing.assert_allclose(after, slipped)


def test_noise_is_as_large_as_stated_and_repeats_with_the_seed():
    config = TrackingConfig(noise=0.003)
    first, again, other = make_bench(config, 1), make_bench(config, 1), make_bench(config, 2)

    samples = np.array([points_at(first, (8 * k + 7.5) * CONTROL) - POINTS for k in range(200)])

    assert np.std(samples) == pytest.approx(0.003, rel=0.1)
    np.testing.assert_array_equal(points_at(again, 7.5 * CONTROL) - POINTS, samples[0])
    assert not np.allclose(points_at(other, 7.5 * CONTROL) - POINTS, samples[0])
