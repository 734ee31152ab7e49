import dataclasses
from pathlib import Path

import numpy as np
import pytest

from poil_drake.benchmarks.control.point_policy import weight_cache
from poil_drake.benchmarks.control.point_policy.config import PointPolicyConfig
from poil_drake.benchmarks.control.point_policy.trained import TrainedPointPolicy
from poil_drake.benchmarks.control.point_policy.weight_cache import load_or_train, training_key
from poil_drake.errors import InvalidValueError

TINY = PointPolicyConfig(width=8, heads=2, layers=1, steps=3, batch=4, history=3, chunk=4)


def demonstrations() -> list[np.ndarray]:
    return list(np.cumsum(np.random.default_rng(0).uniform(0.0, 0.01, (2, 12, 5, 3)), axis=1))


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The user's cache, empty."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "poil_drake"


@pytest.fixture
def trainings(monkeypatch: pytest.MonkeyPatch) -> list[PointPolicyConfig]:
    """The settings of every training that takes place."""
    done: list[PointPolicyConfig] = []
    train = weight_cache.train_point_policy

    def counted(demos: list[np.ndarray], config: PointPolicyConfig) -> TrainedPointPolicy:
        done.append(config)
        return train(demos, config)

    monkeypatch.setattr(weight_cache, "train_point_policy", counted)
    return done


def test_same_policy_is_trained_once(cache: Path, trainings: list[PointPolicyConfig]) -> None:
    first = load_or_train(demonstrations(), TINY)
    again = load_or_train(demonstrations(), TINY)

    assert trainings == [TINY]
    history = demonstrations()[0][:3]
    np.testing.assert_array_equal(first.predict(history), again.predict(history))
    assert len(list(cache.iterdir())) == 1


def test_other_settings_or_data_are_another_policy(
    cache: Path, trainings: list[PointPolicyConfig]
) -> None:
    other = dataclasses.replace(TINY, rotation_noise=0.06)
    load_or_train(demonstrations(), TINY)
    load_or_train(demonstrations(), other)
    load_or_train(demonstrations()[:1], TINY)

    assert trainings == [TINY, other, TINY]
    assert len(list(cache.iterdir())) == 3


@pytest.mark.parametrize("field", [f.name for f in dataclasses.fields(PointPolicyConfig)])
def test_every_setting_changes_the_key(field: str) -> None:
    changed = dataclasses.replace(TINY, **{field: 2 * getattr(TINY, field) or 1})

    assert training_key(demonstrations(), changed) != training_key(demonstrations(), TINY)


def test_one_number_or_the_cut_between_demonstrations_changes_the_key() -> None:
    original = demonstrations()
    nudged = demonstrations()
    nudged[1][3, 2, 1] += 1e-12
    joined = np.concatenate(original)
    cut_elsewhere = [joined[:10], joined[10:]]

    keys = {training_key(data, TINY) for data in (original, nudged, cut_elsewhere)}

    assert len(keys) == 3


@pytest.mark.parametrize("damage", ["empty", "truncated", "flipped", "other"])
def test_damaged_file_is_reported_with_its_path(damage: str, cache: Path) -> None:
    load_or_train(demonstrations(), TINY)
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
        load_or_train(demonstrations(), TINY)


def test_interrupted_training_leaves_no_file(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(weight_cache.np, "savez", interrupted)

    with pytest.raises(KeyboardInterrupt):
        load_or_train(demonstrations(), TINY)

    assert list(cache.iterdir()) == []
