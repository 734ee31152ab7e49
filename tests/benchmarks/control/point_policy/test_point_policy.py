import copy
import subprocess
import sys

import numpy as np
import pytest

from poil_drake.benchmarks.control.point_policy.config import PointPolicyConfig
from poil_drake.benchmarks.control.point_policy.policy import (
    PointPolicy,
    aggregate_chunks,
    twist_between,
)
from poil_drake.benchmarks.control.policies.policy import Observation
from poil_drake.errors import InvalidValueError
from poil_drake.geometry.rigid_transform import rotation_exp

CONFIG = PointPolicyConfig(history=3, chunk=2, aggregation_rate=0.5)
BODY = np.array([[0.1, 0.0, 0.0], [0.0, 0.2, 0.0], [0.0, 0.0, 0.1], [-0.1, -0.1, 0.0]])


class Predictor:
    """Predicts the last observation moved by (1, 0, 0) m in each step, and keeps what it saw."""

    def __init__(self, config: PointPolicyConfig = CONFIG):
        self.config = config
        self.seen: list[np.ndarray] = []

    def predict(self, history: np.ndarray) -> np.ndarray:
        self.seen.append(history)
        steps = np.arange(1.0, 1.0 + self.config.chunk)[:, None, None]
        return history[-1] + steps * np.array([1.0, 0.0, 0.0])


def observe(points: np.ndarray, confidence: np.ndarray | None = None) -> Observation:
    full = np.ones(len(points)) if confidence is None else confidence
    return Observation(0.0, points, full, np.eye(4), np.eye(4))


def test_a_single_chunk_is_its_first_position() -> None:
    chunk = np.stack([BODY + 1.0, BODY + 2.0])

    np.testing.assert_allclose(aggregate_chunks((chunk,), rate=0.5), BODY + 1.0)


def test_chunks_are_averaged_over_the_same_instant_oldest_heaviest() -> None:
    # Made two steps ago, one step ago and now; the next step is their third, second and first.
    chunks = tuple(
        np.array(values)[:, None, None] * np.ones((1, 4, 3))
        for values in ([9.0, 9.0, 1.0], [9.0, 2.0, 9.0], [4.0, 9.0, 9.0])
    )
    a, b, c = 1.0, np.exp(-0.5), np.exp(-1.0)

    target = aggregate_chunks(chunks, rate=0.5)

    np.testing.assert_allclose(target, (a * 1.0 + b * 2.0 + c * 4.0) / (a + b + c))


def test_the_twist_of_a_known_motion_is_found() -> None:
    period, omega, v = 0.25, np.array([0.4, -1.0, 0.8]), np.array([0.1, 0.2, -0.3])
    centroid = BODY.mean(axis=0)
    moved = (BODY - centroid) @ rotation_exp(period * omega).T + centroid + period * v

    twist = twist_between(BODY, moved, period)

    np.testing.assert_allclose(twist.V, [*omega, *v], atol=1e-12)
    np.testing.assert_allclose(twist.point, centroid)


def test_the_twist_reaches_the_aggregated_points_in_one_period() -> None:
    dut = PointPolicy(Predictor())

    _, twist = dut.step(dut.start(), observe(BODY))

    assert dut.period == CONFIG.period
    np.testing.assert_allclose(twist.V, [0, 0, 0, 1.0 / CONFIG.period, 0, 0], atol=1e-12)
    np.testing.assert_allclose(twist.point, BODY.mean(axis=0))


def test_the_first_observation_stands_for_those_before_it() -> None:
    predictor = Predictor()
    dut = PointPolicy(predictor)

    state = dut.start()
    for k in range(4):
        state, _ = dut.step(state, observe(BODY + k))

    shifts = [(history - BODY)[:, 0, 0] for history in predictor.seen]
    np.testing.assert_allclose(shifts, [[0, 0, 0], [0, 0, 1], [0, 1, 2], [1, 2, 3]], atol=1e-12)


def test_chunks_that_reach_no_further_than_now_are_dropped() -> None:
    dut = PointPolicy(Predictor())

    state = dut.start()
    for _ in range(5):
        state, _ = dut.step(state, observe(BODY))

    assert len(state.chunks) == CONFIG.chunk
    assert len(state.history) == CONFIG.history


def test_the_state_passed_stays_as_it_was() -> None:
    dut = PointPolicy(Predictor())
    state, _ = dut.step(dut.start(), observe(BODY))
    before = copy.deepcopy(state)

    first = dut.step(state, observe(BODY + 1.0))
    again = dut.step(state, observe(BODY + 1.0))

    np.testing.assert_array_equal(state.history, before.history)
    np.testing.assert_array_equal(state.chunks, before.chunks)
    np.testing.assert_array_equal(first[1].V, again[1].V)
    assert dut.start() == ((), ())


def test_what_was_observed_is_not_changed_by_later_writes() -> None:
    dut = PointPolicy(Predictor())
    points = BODY.copy()
    state, _ = dut.step(dut.start(), observe(points))

    points += 1.0

    np.testing.assert_array_equal(state.history[-1], BODY)


def test_nothing_moves_before_every_point_was_seen() -> None:
    dut = PointPolicy(Predictor())
    points = BODY.copy()
    points[1] = np.nan

    state, twist = dut.step(dut.start(), observe(points))

    assert state == dut.start()
    np.testing.assert_array_equal(twist.V, 0.0)


@pytest.mark.parametrize("how", ["NaN", "no confidence"])
def test_a_point_not_observed_goes_with_the_others(how: str) -> None:
    dut = PointPolicy(Predictor())
    state, _ = dut.step(dut.start(), observe(BODY))
    moved = BODY @ rotation_exp(np.array([0.0, 0.0, 0.3])).T + 0.1
    points, confidence = moved.copy(), np.ones(4)
    if how == "NaN":
        points[1] = np.nan
    else:
        points[1], confidence[1] = 5.0, 0.0

    state, _ = dut.step(state, observe(points, confidence))

    np.testing.assert_allclose(state.history[-1], moved, atol=1e-12)


def test_points_stay_where_too_few_are_observed() -> None:
    dut = PointPolicy(Predictor())
    state, _ = dut.step(dut.start(), observe(BODY))
    points = BODY + 1.0
    points[:2] = np.nan

    state, _ = dut.step(state, observe(points))

    np.testing.assert_array_equal(state.history[-1], BODY)


def test_a_policy_is_run_without_torch() -> None:
    code = (
        "import sys, poil_drake.benchmarks.control.point_policy.policy, "
        "poil_drake.benchmarks.control.point_policy.weight_cache; "
        "sys.exit('torch' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], check=False)

    assert done.returncode == 0


@pytest.mark.parametrize(
    "wrong",
    [
        {"history": 0},
        {"steps": 0},
        {"period": 0.0},
        {"translation_noise": -1.0},
        {"warm_up": 1.0},
        {"halt_probability": 1.5},
        {"width": 30, "heads": 4},
    ],
    ids=str,
)
def test_impossible_settings_are_refused(wrong: dict) -> None:
    with pytest.raises(InvalidValueError):
        PointPolicyConfig(**wrong)
