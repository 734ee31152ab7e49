import numpy as np

from poil_drake.benchmarks.control.point_policy.normalization import Normalization
from poil_drake.benchmarks.control.point_policy.windows import Windows, cut_windows


def random_windows(*, scale: float = 1.0, shift: float = 0.0) -> Windows:
    demonstration = np.cumsum(np.random.default_rng(0).standard_normal((30, 5, 3)), axis=0)
    return cut_windows([scale * demonstration + shift], history=4, chunk=6, rest=3)


def test_inputs_and_targets_are_ordered_by_point() -> None:
    windows = random_windows()
    dut = Normalization.of(windows)

    assert dut.inputs(windows.histories).shape == (33, 5, 4 * 3)
    assert dut.targets(windows.futures).shape == (33, 5, 6 * 3)


def test_past_and_future_are_absolute_positions_in_the_box_of_the_data() -> None:
    dut = Normalization(np.array([1.0, 2.0, 3.0]), np.array([3.0, 6.0, 4.0]))
    corners_and_center = np.array([[1.0, 2.0, 3.0], [3.0, 6.0, 4.0], [2.0, 4.0, 3.5]])
    stretch = corners_and_center[:, None]  # One point at three instants.

    wanted = [[-1, -1, -1, 1, 1, 1, 0, 0, 0]]
    np.testing.assert_allclose(dut.inputs(stretch), wanted)
    np.testing.assert_allclose(dut.targets(stretch), wanted)


def test_the_box_holds_all_points_of_all_demonstrations() -> None:
    low, high = np.zeros((4, 2, 3)), np.zeros((3, 2, 3))
    low[-1, 1] = [-1.0, -2.0, -3.0]
    high[0, 0] = [4.0, 5.0, 6.0]

    dut = Normalization.of(cut_windows([low, high], history=2, chunk=2, rest=0))

    np.testing.assert_array_equal(dut.lower, [-1.0, -2.0, -3.0])
    np.testing.assert_array_equal(dut.upper, [4.0, 5.0, 6.0])


def test_shifted_and_scaled_data_give_the_same_numbers() -> None:
    metres, millimetres = random_windows(), random_windows(scale=1000.0, shift=70.0)
    a, b = Normalization.of(metres), Normalization.of(millimetres)

    np.testing.assert_allclose(
        a.inputs(metres.histories), b.inputs(millimetres.histories), atol=1e-5
    )
    np.testing.assert_allclose(a.targets(metres.futures), b.targets(millimetres.futures), atol=1e-5)


def test_positions_undo_targets() -> None:
    windows = random_windows()
    dut = Normalization.of(windows)

    positions = dut.positions(dut.targets(windows.futures[7]))

    np.testing.assert_allclose(positions, windows.futures[7], atol=1e-5)


def test_points_that_never_move_are_no_division_by_zero() -> None:
    windows = cut_windows([np.ones((5, 4, 3))], history=3, chunk=2, rest=0)
    dut = Normalization.of(windows)

    np.testing.assert_array_equal(dut.inputs(windows.histories), 0.0)
    np.testing.assert_array_equal(dut.targets(windows.futures), 0.0)


def test_an_axis_along_which_nothing_moved_keeps_noise_small() -> None:
    demonstration = np.random.default_rng(0).uniform(0.0, 0.3, (10, 4, 3))
    demonstration[..., 2] = 0.1
    windows = cut_windows([demonstration], history=3, chunk=2, rest=0)
    dut = Normalization.of(windows)

    inputs = dut.inputs(windows.histories + 0.001)

    # 1 mm of the smallest half range, 1 mm.
    np.testing.assert_allclose(inputs[..., 2::3], 1.0, rtol=1e-5)
