import copy
import subprocess
import sys

import numpy as np

from poil_drake.benchmarks.control.point_policy.network import PointPolicyConfig
from poil_drake.benchmarks.control.point_policy.policy import (
    PointPolicy,
    aggregate_chunks,
    twist_between,
)
from poil_drake.benchmarks.control.policies.policy import Observation
from poil_drake.geometry.rigid_transform import rotation_exp

CONFIG = PointPolicyConfig(history=3, chunk=2, aggregation_rate=0.5)
BODY = np.array([[0.1, 0.0, 0.0], [0.0, 0.2, 0.0], [0.0, 0.0, 0.1], [-0.1, -0.1, 0.0]])


class Predictor:
    """Predicts the last observation moved by (1, 0, 0) m per step, and records the histories."""

    config = CONFIG

    def __init__(self) -> None:
        self.histories: list[np.ndarray] = []

    def predict(self, history: np.ndarray) -> np.ndarray:
        self.histories.append(history)
        steps = np.arange(1.0, 1.0 + self.config.chunk)[:, None, None]
        return history[-1] + steps * np.array([1.0, 0.0, 0.0])


def observe(points: np.ndarray) -> Observation:
    return Observation(0.0, points, np.ones(len(points)), np.eye(4), np.eye(4))


def test_chunks_are_averaged_over_the_same_instant_with_most_weight_on_the_oldest() -> None:
    # Made two steps ago, one step ago and now; the next step is their third, second and first.
    chunks = tuple(
        np.array(values)[:, None, None] * np.ones((1, 4, 3))
        for values in ([9.0, 9.0, 1.0], [9.0, 2.0, 9.0], [4.0, 9.0, 9.0])
    )
    a, b, c = 1.0, np.exp(-0.5), np.exp(-1.0)

    target = aggregate_chunks(chunks, rate=0.5)

    np.testing.assert_allclose(target, (a * 1.0 + b * 2.0 + c * 4.0) / (a + b + c))


def test_twist_of_a_known_motion_is_found() -> None:
    period, omega, v = 0.25, np.array([0.4, -1.0, 0.8]), np.array([0.1, 0.2, -0.3])
    centroid = BODY.mean(axis=0)
    moved = (BODY - centroid) @ rotation_exp(period * omega).T + centroid + period * v

    twist = twist_between(BODY, moved, period)

    np.testing.assert_allclose(twist.V, [*omega, *v], atol=1e-12)
    np.testing.assert_allclose(twist.point, centroid)


def test_twist_reaches_the_predicted_points_in_one_period() -> None:
    dut = PointPolicy(Predictor())

    _, twist = dut.step(dut.start(), observe(BODY))

    assert dut.period == CONFIG.period
    np.testing.assert_allclose(twist.V, [0, 0, 0, 1.0 / CONFIG.period, 0, 0], atol=1e-12)
    np.testing.assert_allclose(twist.point, BODY.mean(axis=0))


def test_first_observation_is_repeated_and_old_ones_are_dropped() -> None:
    predictor = Predictor()
    dut = PointPolicy(predictor)

    state = dut.start()
    for k in range(4):
        state, _ = dut.step(state, observe(BODY + k))

    shifts = [(history - BODY)[:, 0, 0] for history in predictor.histories]
    np.testing.assert_allclose(shifts, [[0, 0, 0], [0, 0, 1], [0, 1, 2], [1, 2, 3]], atol=1e-12)
    assert len(state.history) == CONFIG.history
    assert len(state.chunks) == CONFIG.chunk


def test_state_is_not_changed_by_steps_or_by_writes_to_observations() -> None:
    dut = PointPolicy(Predictor())
    points = BODY.copy()
    state, _ = dut.step(dut.start(), observe(points))
    before = copy.deepcopy(state)

    first = dut.step(state, observe(BODY + 1.0))
    again = dut.step(state, observe(BODY + 1.0))
    points += 1.0

    np.testing.assert_array_equal(state.history, before.history)
    np.testing.assert_array_equal(state.chunks, before.chunks)
    np.testing.assert_array_equal(first[1].V, again[1].V)


def test_policy_runs_without_torch() -> None:
    code = (
        "import sys, poil_drake.benchmarks.control.point_policy.policy, "
        "poil_drake.benchmarks.control.point_policy.training; "
        "sys.exit('torch' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], check=False)

    assert done.returncode == 0
