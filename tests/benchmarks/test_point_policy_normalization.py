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
    assert dut.targets(windows.histories, windows.futures).shape == (33, 5, 6 * 3)


def test_the_last_input_is_the_place_and_the_others_are_the_way_there() -> None:
    windows = random_windows()
    dut = Normalization.of(windows)
    history = windows.histories[10]

    inputs = dut.inputs(history)

    np.testing.assert_allclose(inputs[2, 9:], (history[3, 2] - dut.center) / dut.length, rtol=1e-5)
    np.testing.assert_allclose(
        inputs[2, 3:6], (history[1, 2] - history[3, 2]) / dut.motions[1], rtol=1e-5
    )


def test_shifted_and_scaled_data_give_the_same_numbers() -> None:
    metres, millimetres = random_windows(), random_windows(scale=1000.0, shift=70.0)
    a, b = Normalization.of(metres), Normalization.of(millimetres)

    np.testing.assert_allclose(
        a.inputs(metres.histories), b.inputs(millimetres.histories), atol=1e-5
    )
    np.testing.assert_allclose(
        a.targets(metres.histories, metres.futures),
        b.targets(millimetres.histories, millimetres.futures),
        atol=1e-5,
    )


def test_the_data_have_unit_size() -> None:
    windows = random_windows()
    dut = Normalization.of(windows)

    inputs = dut.inputs(windows.histories).reshape(33, 5, 4, 3)
    targets = dut.targets(windows.histories, windows.futures).reshape(33, 5, 6, 3)

    np.testing.assert_allclose(np.mean(inputs**2, axis=(0, 1, 3)), 1.0, rtol=1e-5)
    np.testing.assert_allclose(np.mean(targets**2, axis=(0, 1, 3)), 1.0, rtol=1e-5)


def test_positions_undo_targets() -> None:
    windows = random_windows()
    dut = Normalization.of(windows)
    history, future = windows.histories[7], windows.futures[7]

    positions = dut.positions(dut.targets(history, future), history[-1])

    np.testing.assert_allclose(positions, future, atol=1e-5)


def test_points_that_never_move_are_no_division_by_zero() -> None:
    windows = cut_windows([np.ones((5, 4, 3))], history=3, chunk=2, rest=0)
    dut = Normalization.of(windows)

    np.testing.assert_array_equal(dut.inputs(windows.histories), 0.0)
    np.testing.assert_array_equal(dut.targets(windows.histories, windows.futures), 0.0)
