import numpy as np
import pytest

from poil_drake.geometry.all_finite import all_finite


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_one_bad_number_is_enough(value: float) -> None:
    values = np.zeros((2, 3))
    values[1, 1] = value

    assert not all_finite(values)


def test_the_largest_numbers_are_finite() -> None:
    assert all_finite(np.full(3, np.finfo(float).max))
