import dataclasses
from pathlib import Path

import numpy as np
import pytest
import torch

from poil_drake.benchmarks.control.point_policy import training
from poil_drake.benchmarks.control.point_policy.network import PointPolicyConfig, TrainedPointPolicy
from poil_drake.benchmarks.control.point_policy.policy import PointPolicy
from poil_drake.benchmarks.control.point_policy.training import (
    learning_rate_factor,
    load_or_train,
    train_point_policy,
    training_key,
)
from poil_drake.benchmarks.control.policies.policy import Observation
from poil_drake.errors import InvalidValueError
from poil_drake.geometry.rigid_transform import rotation_exp

SMALL = PointPolicyConfig(width=32, layers=1, steps=1500, learning_rate=4e-3)
CALM = dataclasses.replace(SMALL, translation_noise=0.0, rotation_noise=0.0, halt_probability=0.0)
TINY = PointPolicyConfig(width=8, heads=2, layers=1, steps=5, batch=8)


# A quarter of a circle of 0.2 m in 2 s, from rest to rest, the points turning with it.
BODY = np.random.default_rng(0).uniform(-0.04, 0.04, (10, 3)) + np.array([0.2, 0.0, 0.1])
PROGRESS = 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, 33))
ARC = BODY @ np.swapaxes(rotation_exp(PROGRESS[:, None] * [0.0, 0.0, 0.5 * np.pi]), -1, -2)


DEMONSTRATIONS = list(np.cumsum(np.random.default_rng(0).uniform(0.0, 0.01, (2, 12, 5, 3)), axis=1))


def run(policy: PointPolicy, points: np.ndarray, steps: int) -> np.ndarray:
    """Returns the path (steps + 1, N, 3) of points (N, 3) that move as the policy commands."""
    state = policy.start()
    path = [points]
    for k in range(steps):
        full, pose = np.ones(len(points)), np.eye(4)
        observation = Observation(k * policy.period, points, full, pose, pose)
        state, (V, center) = policy.step(state, observation)
        R = rotation_exp(V[:3] * policy.period)
        points = (points - center) @ R.T + center + V[3:] * policy.period
        path.append(points)
    return np.array(path)


@pytest.fixture(scope="module")
def trained() -> TrainedPointPolicy:
    return train_point_policy([ARC], SMALL)


@pytest.fixture(scope="module")
def without_noise() -> TrainedPointPolicy:
    return train_point_policy([ARC], CALM)


def test_single_demonstration_is_reproduced(trained: TrainedPointPolicy) -> None:
    path = run(PointPolicy(trained), ARC[0], steps=80)

    distances = np.linalg.norm(path[:, None] - ARC, axis=-1).mean(axis=-1)
    # The points pass within 1 cm of each sample of a path of 31 cm, and stay at its end.
    assert distances.min(axis=0).max() < 0.01
    assert distances.min(axis=1).max() < 0.01
    assert distances[-16:, -1].max() < 0.005
    chunk = trained.predict(ARC[5:15])
    assert np.linalg.norm(chunk[:18] - ARC[15:], axis=-1).mean() < 0.02


@pytest.mark.parametrize("offset", [[0.05, 0.0, 0.0], [0.0, -0.05, 0.0], [0.0, 0.0, 0.05]], ids=str)
def test_demonstrated_end_is_reached_from_another_start(
    without_noise: TrainedPointPolicy, offset: list[float]
) -> None:
    path = run(PointPolicy(without_noise), ARC[0] + np.array(offset), steps=80)

    # A policy that learned displacements would keep 3 cm or more of the offset of 5 cm. The limit
    # is the study's limit for success.
    assert np.linalg.norm(path[-1] - ARC[-1], axis=-1).mean() < 0.01


def test_policy_recovers_from_a_slip(trained: TrainedPointPolicy) -> None:
    path = run(PointPolicy(trained), ARC[10] + np.array([0.01, 0.0, -0.01]), steps=80)

    assert np.linalg.norm(path[-1] - ARC[-1], axis=-1).mean() < 0.01


def test_training_follows_the_seed() -> None:
    first = train_point_policy([ARC], TINY)
    again = train_point_policy([ARC], TINY)
    other = train_point_policy([ARC], dataclasses.replace(TINY, seed=1))

    for name, values in first.weights.items():
        np.testing.assert_array_equal(values, again.weights[name])
    assert not np.array_equal(first.weights["head.w"], other.weights["head.w"])


def test_demonstrations_may_differ_in_length() -> None:
    demonstrations = [ARC[: 20 + k] + 0.01 * k for k in range(10)]

    dut = train_point_policy(demonstrations, TINY)

    assert all(np.isfinite(values).all() for values in dut.weights.values())


def test_training_restores_the_threads_of_torch() -> None:
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    try:
        train_point_policy([ARC], TINY)
        assert torch.get_num_threads() == 2
    finally:
        torch.set_num_threads(before)


def test_learning_rate_rises_then_falls_to_zero() -> None:
    config = PointPolicyConfig(steps=100, warm_up=0.2)
    factors = [learning_rate_factor(k, config) for k in range(100)]

    np.testing.assert_allclose(np.diff(factors[:20]), 1.0 / 21.0)
    assert factors[20] == 1.0
    # Half a cosine over 80 steps is at one half after 40.
    assert factors[60] == pytest.approx(0.5)
    assert 0.0 < factors[99] < 0.001
    assert np.all(np.diff(factors[20:]) < 0.0)


def test_step_at_the_full_rate_is_that_of_adam() -> None:
    config = dataclasses.replace(TINY, steps=1, warm_up=0.0, learning_rate=0.01)

    dut = train_point_policy([ARC], config)

    # The head starts at zero, and Adam's first step has the size of its rate whatever the gradient.
    np.testing.assert_allclose(np.abs(dut.weights["head.w"]), 0.01, rtol=1e-3)


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The user's cache, empty."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "poil_drake"


@pytest.fixture
def trainings(monkeypatch: pytest.MonkeyPatch) -> list[PointPolicyConfig]:
    """The settings of every training that takes place."""
    done: list[PointPolicyConfig] = []
    train = training.train_point_policy

    def counted(demos: list[np.ndarray], config: PointPolicyConfig) -> TrainedPointPolicy:
        done.append(config)
        return train(demos, config)

    monkeypatch.setattr(training, "train_point_policy", counted)
    return done


def test_same_policy_is_trained_once(cache: Path, trainings: list[PointPolicyConfig]) -> None:
    first = load_or_train(DEMONSTRATIONS, TINY)
    again = load_or_train(DEMONSTRATIONS, TINY)

    assert trainings == [TINY]
    history = DEMONSTRATIONS[0][: TINY.history]
    np.testing.assert_array_equal(first.predict(history), again.predict(history))
    assert len(list(cache.iterdir())) == 1


def test_other_settings_or_data_are_another_policy(
    cache: Path, trainings: list[PointPolicyConfig]
) -> None:
    other = dataclasses.replace(TINY, rotation_noise=0.06)
    load_or_train(DEMONSTRATIONS, TINY)
    load_or_train(DEMONSTRATIONS, other)
    load_or_train(DEMONSTRATIONS[:1], TINY)

    assert trainings == [TINY, other, TINY]
    assert len(list(cache.iterdir())) == 3


@pytest.mark.parametrize("field", [f.name for f in dataclasses.fields(PointPolicyConfig)])
def test_every_setting_changes_the_key(field: str) -> None:
    changed = dataclasses.replace(TINY, **{field: 2 * getattr(TINY, field) or 1})

    assert training_key(DEMONSTRATIONS, changed) != training_key(DEMONSTRATIONS, TINY)


def test_one_number_or_the_cut_between_demonstrations_changes_the_key() -> None:
    nudged = [one.copy() for one in DEMONSTRATIONS]
    nudged[1][3, 2, 1] += 1e-12
    joined = np.concatenate(DEMONSTRATIONS)
    cut_elsewhere = [joined[:10], joined[10:]]

    keys = {training_key(data, TINY) for data in (DEMONSTRATIONS, nudged, cut_elsewhere)}

    assert len(keys) == 3


@pytest.mark.parametrize("damage", ["empty", "truncated", "flipped", "other"])
def test_damaged_file_is_reported_with_its_path(damage: str, cache: Path) -> None:
    load_or_train(DEMONSTRATIONS, TINY)
    (path,) = cache.glob("*/*.npz")
    content = path.read_bytes()
    middle = len(content) // 2
    if damage == "other":
        np.savez(path, something=np.zeros(3))
    elif damage == "flipped":
        flipped = bytes([content[middle] ^ 0xFF])
        path.write_bytes(content[:middle] + flipped + content[middle + 1 :])
    else:
        path.write_bytes(content[: middle if damage == "truncated" else 0])

    with pytest.raises(InvalidValueError, match=str(path)):
        load_or_train(DEMONSTRATIONS, TINY)


def test_interrupted_training_leaves_no_file(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(training.np, "savez", interrupted)

    with pytest.raises(KeyboardInterrupt):
        load_or_train(DEMONSTRATIONS, TINY)

    assert list(cache.iterdir()) == []
