import numpy as np

from poil_drake.benchmarks.control.point_policy.trained import Normalization


def test_positions_are_numbers_in_the_box_of_the_data_ordered_by_point() -> None:
    dut = Normalization(np.array([1.0, 2.0, 3.0]), np.array([3.0, 6.0, 4.0]))
    lower, upper, center = np.array([[1.0, 2.0, 3.0], [3.0, 6.0, 4.0], [2.0, 4.0, 3.5]])
    # Two points at three instants.
    stretch = np.array([[lower, center], [upper, center], [center, lower]])

    wanted = [[-1, -1, -1, 1, 1, 1, 0, 0, 0], [0, 0, 0, 0, 0, 0, -1, -1, -1]]
    np.testing.assert_allclose(dut.numbers(stretch), wanted)
    np.testing.assert_allclose(dut.positions(dut.numbers(stretch)), stretch)


def test_box_holds_all_points_of_all_demonstrations() -> None:
    low, high = np.zeros((4, 2, 3)), np.zeros((3, 2, 3))
    low[-1, 1] = [-1.0, -2.0, -3.0]
    high[0, 0] = [4.0, 5.0, 6.0]

    dut = Normalization.of([low, high])

    np.testing.assert_array_equal(dut.lower, [-1.0, -2.0, -3.0])
    np.testing.assert_array_equal(dut.upper, [4.0, 5.0, 6.0])


def test_axis_without_motion_does_not_magnify_noise() -> None:
    demonstration = np.random.default_rng(0).uniform(0.0, 0.3, (10, 4, 3))
    demonstration[..., 2] = 0.1
    dut = Normalization.of([demonstration])

    numbers = dut.numbers(demonstration + 0.001)

    # 1 mm of the smallest half range, 1 mm.
    np.testing.assert_allclose(numbers[..., 2::3], 1.0, rtol=1e-5)
