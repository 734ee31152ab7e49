import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from poil_drake.benchmarks.control.delayed_tracking import DelayedTracking, TrackingConfig
from poil_drake.geometry.rigid_transform import make_transform, rotation_exp, transform_points

POINTS = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0]])
NOISELESS = TrackingConfig(noise=0.0)
CONTROL = NOISELESS.control_period


class Bench:
    """The tracker with inputs that the test sets."""

    def __init__(self, config=NOISELESS, seed=0):
        self.dut = DelayedTracking(num_points=3, config=config)
        self.simulator = Simulator(self.dut)
        self.context = self.simulator.get_mutable_context()
        self.dut.SetSeed(self.context, seed)
        self.show(POINTS, np.eye(4))

    def show(self, points, X_WH):
        self.dut.GetInputPort("points").FixValue(self.context, points.ravel())
        self.dut.GetInputPort("hand_pose").FixValue(self.context, X_WH.ravel())

    def advance(self, time):
        self.simulator.AdvanceTo(time)
        return self.dut.GetOutputPort("points").Eval(self.context).reshape(-1, 3)

    def confidence(self):
        return self.dut.GetOutputPort("confidence").Eval(self.context)


def test_nothing_is_known_before_the_first_result():
    bench = Bench()

    points = bench.advance(0.1)

    assert np.isnan(points).all()
    assert not bench.confidence().any()


def test_first_result_is_there_after_the_latency():
    bench = Bench()

    # 0.1 s is 6.4 control periods; the event of the seventh is done when time has passed it.
    points = bench.advance(7.5 * CONTROL)

    np.testing.assert_allclose(points, POINTS)
    assert bench.confidence().all()


def test_points_are_carried_along_with_the_hand():
    bench = Bench()
    bench.advance(7.5 * CONTROL)
    X = make_transform(rotation_exp([0.0, 0.0, 0.3]), np.array([0.05, 0.0, 0.02]))

    bench.show(transform_points(X, POINTS), X)
    points = bench.advance(8.5 * CONTROL)

    np.testing.assert_allclose(points, transform_points(X, POINTS), atol=1e-12)


def test_slip_shows_with_the_delay_of_the_tracker():
    bench = Bench()
    bench.advance(10.5 * CONTROL)
    slipped = POINTS + np.array([0.03, 0.0, 0.0])

    bench.show(slipped, np.eye(4))
    # The next capture is that of the 16th control period, and released seven later.
    before, after = bench.advance(22.5 * CONTROL), bench.advance(23.5 * CONTROL)

    np.testing.assert_allclose(before, POINTS)
    np.testing.assert_allclose(after, slipped)


def test_noise_is_as_large_as_stated_and_repeats_with_the_seed():
    config = TrackingConfig(noise=0.003)
    first, again, other = Bench(config, 1), Bench(config, 1), Bench(config, 2)

    samples = np.array([first.advance((8 * k + 7.5) * CONTROL) - POINTS for k in range(200)])

    assert np.std(samples) == pytest.approx(0.003, rel=0.1)
    np.testing.assert_array_equal(again.advance(7.5 * CONTROL) - POINTS, samples[0])
    assert not np.allclose(other.advance(7.5 * CONTROL) - POINTS, samples[0])
