import dataclasses

import numpy as np
import pytest

from poil_drake.benchmarks.control.point_policy.network import PointPolicyConfig
from poil_drake.benchmarks.control.point_policy.training import cut_windows, perturb_histories

CALM = PointPolicyConfig(translation_noise=0.0, rotation_noise=0.0, halt_probability=0.0)


def counting_demonstration(samples: int, points: int = 4, start: float = 0.0) -> np.ndarray:
    """Every coordinate of sample t is start + t."""
    t = start + np.arange(float(samples))
    return np.broadcast_to(t[:, None, None], (samples, points, 3)).copy()


def cut(demonstrations: list[np.ndarray], **lengths: int) -> tuple[np.ndarray, np.ndarray]:
    return cut_windows(demonstrations, PointPolicyConfig(**lengths))


@pytest.fixture
def histories() -> np.ndarray:
    return np.random.default_rng(0).uniform(-0.1, 0.1, (6, 5, 4, 3))


def perturb(histories: np.ndarray, **noise: float) -> np.ndarray:
    config = dataclasses.replace(CALM, **noise)
    return perturb_histories(histories, config, np.random.default_rng(0))


def test_every_sample_and_every_sample_at_rest_makes_a_window() -> None:
    demonstrations = [counting_demonstration(7), counting_demonstration(5)]

    histories, futures = cut(demonstrations, history=3, chunk=2, rest=4)

    assert histories.shape == (7 + 4 + 5 + 4, 3, 4, 3)
    assert futures.shape == (7 + 4 + 5 + 4, 2, 4, 3)


@pytest.mark.parametrize(
    ("window", "past", "future"),
    [(0, [5, 5, 5], [6, 7]), (1, [5, 5, 6], [7, 8]), (3, [6, 7, 8], [9, 9]), (7, [9] * 3, [9] * 2)],
    ids=["first", "second", "second last", "at rest"],
)
def test_window_holds_past_and_future_with_first_and_last_sample_repeated(
    window: int, past: list[int], future: list[int]
) -> None:
    histories, futures = cut([counting_demonstration(5, start=5.0)], history=3, chunk=2, rest=3)

    np.testing.assert_array_equal(histories[window, :, 0, 0], past)
    np.testing.assert_array_equal(futures[window, :, 0, 0], future)


def test_windows_do_not_extend_into_another_demonstration() -> None:
    demonstrations = [counting_demonstration(3), counting_demonstration(3, start=100.0)]

    histories, futures = cut(demonstrations, history=5, chunk=5, rest=2)

    assert histories[:5].max() == futures[:5].max() == 2.0
    assert histories[5:].min() == 100.0
    assert futures[5:].min() == 101.0


def test_no_noise_changes_nothing(histories: np.ndarray) -> None:
    np.testing.assert_allclose(perturb(histories), histories, atol=1e-15)


def test_noise_keeps_shapes_and_its_argument(histories: np.ndarray) -> None:
    before = histories.copy()

    perturbed = perturb(histories, translation_noise=0.1, rotation_noise=0.5, halt_probability=0.5)

    np.testing.assert_array_equal(histories, before)
    np.testing.assert_allclose(
        np.linalg.norm(np.diff(perturbed[:, -1], axis=1), axis=-1),
        np.linalg.norm(np.diff(histories[:, -1], axis=1), axis=-1),
        atol=1e-12,
    )


def test_current_observation_is_shifted_by_the_stated_noise() -> None:
    perturbed = perturb(np.zeros((20_000, 2, 1, 3)), translation_noise=0.02)

    # The standard deviation of 60,000 draws is known to 0.3 % (1 sigma).
    assert perturbed[:, -1].std() == pytest.approx(0.02, rel=0.02)


def test_current_observation_is_rotated_by_the_stated_noise() -> None:
    pair = np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]])

    perturbed = perturb(np.broadcast_to(pair, (20_000, 2, 2, 3)), rotation_noise=0.01)

    # A small rotation w of a point at (1, 0, 0) moves it by (0, w_z, -w_y).
    assert perturbed[:, -1, 1, 1:].std() == pytest.approx(0.01, rel=0.02)


def test_halted_history_repeats_its_current_observation(histories: np.ndarray) -> None:
    perturbed = perturb(histories, halt_probability=1.0)

    np.testing.assert_allclose(
        perturbed, np.broadcast_to(histories[:, -1:], histories.shape), atol=1e-15
    )
