import dataclasses

import numpy as np
import pytest

from poil_drake.benchmarks.control.point_policy.config import PointPolicyConfig
from poil_drake.benchmarks.control.point_policy.windows import (
    Windows,
    cut_windows,
    perturb_histories,
)

CALM = PointPolicyConfig(translation_noise=0.0, rotation_noise=0.0, halt_probability=0.0)


def counting_demonstration(samples: int, points: int = 4, start: float = 0.0) -> np.ndarray:
    """Every coordinate of sample t is start + t."""
    t = start + np.arange(float(samples))
    return np.broadcast_to(t[:, None, None], (samples, points, 3)).copy()


def cut(demonstrations: list[np.ndarray], **lengths: int) -> Windows:
    return cut_windows(demonstrations, PointPolicyConfig(**lengths))


def random_histories(batch: int = 6, length: int = 5, points: int = 4) -> np.ndarray:
    return np.random.default_rng(0).uniform(-0.1, 0.1, (batch, length, points, 3))


def test_every_sample_and_every_sample_at_rest_makes_a_window() -> None:
    demonstrations = [counting_demonstration(7), counting_demonstration(5)]

    dut = cut(demonstrations, history=3, chunk=2, rest=4)

    assert dut.histories.shape == (7 + 4 + 5 + 4, 3, 4, 3)
    assert dut.futures.shape == (7 + 4 + 5 + 4, 2, 4, 3)


def test_a_window_holds_the_past_up_to_now_and_what_comes_next() -> None:
    dut = cut([counting_demonstration(9)], history=3, chunk=4, rest=0)

    np.testing.assert_array_equal(dut.histories[4, :, 0, 0], [2, 3, 4])
    np.testing.assert_array_equal(dut.futures[4, :, 0, 0], [5, 6, 7, 8])


def test_the_first_sample_is_repeated_before_the_start() -> None:
    dut = cut([counting_demonstration(9, start=5.0)], history=4, chunk=1, rest=0)

    np.testing.assert_array_equal(dut.histories[0, :, 0, 0], [5, 5, 5, 5])
    np.testing.assert_array_equal(dut.histories[1, :, 0, 0], [5, 5, 5, 6])


def test_the_last_sample_is_repeated_behind_the_end() -> None:
    dut = cut([counting_demonstration(4)], history=3, chunk=2, rest=3)

    np.testing.assert_array_equal(dut.futures[2, :, 0, 0], [3, 3])
    np.testing.assert_array_equal(dut.histories[-1, :, 0, 0], [3, 3, 3])
    np.testing.assert_array_equal(dut.futures[-1, :, 0, 0], [3, 3])


def test_no_demonstration_looks_into_another() -> None:
    demonstrations = [counting_demonstration(3), counting_demonstration(3, start=100.0)]

    dut = cut(demonstrations, history=5, chunk=5, rest=2)

    assert dut.histories[:5].max() == dut.futures[:5].max() == 2.0
    assert dut.histories[5:].min() == 100.0
    assert dut.futures[5:].min() == 101.0


def test_no_noise_changes_nothing() -> None:
    histories = random_histories()

    perturbed = perturb_histories(histories, CALM, np.random.default_rng(0))

    np.testing.assert_allclose(perturbed, histories, atol=1e-15)


def test_noise_keeps_shapes_and_the_array_passed() -> None:
    histories = random_histories()
    before = histories.copy()
    config = PointPolicyConfig(translation_noise=0.1, rotation_noise=0.5, halt_probability=0.5)

    perturbed = perturb_histories(histories, config, np.random.default_rng(0))

    np.testing.assert_array_equal(histories, before)
    np.testing.assert_allclose(
        np.linalg.norm(np.diff(perturbed[:, -1], axis=1), axis=-1),
        np.linalg.norm(np.diff(histories[:, -1], axis=1), axis=-1),
        atol=1e-12,
    )


def test_the_current_observation_is_shifted_by_the_stated_noise() -> None:
    histories = np.zeros((20_000, 2, 1, 3))
    config = dataclasses.replace(CALM, translation_noise=0.02)

    perturbed = perturb_histories(histories, config, np.random.default_rng(0))

    # The standard deviation of 60,000 draws is known to 0.3 % (1 sigma).
    assert perturbed[:, -1].std() == pytest.approx(0.02, rel=0.02)


def test_the_current_observation_is_turned_by_the_stated_noise() -> None:
    pair = np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    histories = np.broadcast_to(pair, (20_000, 2, 2, 3))
    config = dataclasses.replace(CALM, rotation_noise=0.01)

    perturbed = perturb_histories(histories, config, np.random.default_rng(0))

    # A small turn w of a point at (1, 0, 0) moves it by (0, w_z, -w_y).
    assert perturbed[:, -1, 1, 1:].std() == pytest.approx(0.01, rel=0.02)


def test_a_history_that_halted_repeats_its_current_observation() -> None:
    histories = random_histories()
    config = dataclasses.replace(CALM, halt_probability=1.0)

    perturbed = perturb_histories(histories, config, np.random.default_rng(0))

    np.testing.assert_allclose(
        perturbed, np.broadcast_to(histories[:, -1:], histories.shape), atol=1e-15
    )
