"""Each term of the field by itself, on states where it alone decides."""

import numpy as np
import pytest
from point_references import resting_reference, still_reference, straight_reference

from poil_drake.control.field.point_set_bcsdm import BcsdmConfig
from poil_drake.control.field.point_set_bcsdm import point_set_bcsdm as dut

BODY = 0.03 * np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 0.5], [0, 0, -0.5]])


STRAIGHT = straight_reference(BODY, 9)


def test_confidence_weighs_the_closest_configuration():
    # Half of the points are 1 cm ahead of the others.
    points = BODY + np.array([0.05, 0.0, 0.0])
    points[:3, 0] += 0.01
    confidence = np.array([1.0, 1.0, 1.0, 0.25, 0.25, 0.25])

    output = dut(points, STRAIGHT, BcsdmConfig(outlier_test="none"), confidence)

    # (3 * 6 cm + 0.75 * 5 cm) / 3.75 at 0.1 m/s.
    assert output.tau == pytest.approx(0.58)


@pytest.mark.parametrize("outlier_test", ["rigidity", "velocity"])
def test_confidence_decides_which_half_of_the_points_are_outliers(outlier_test):
    points = BODY.copy()
    points[[1, 3, 5]] += np.array([0.0, 0.0, 0.04])
    reference = resting_reference(BODY)
    stays = np.array([1.0, 0.5] * 3)
    config = BcsdmConfig(outlier_test=outlier_test)

    first = dut(points, reference, config, stays)
    other = dut(points, reference, config, stays[::-1])

    assert first.inliers.tolist() == [True, False] * 3
    assert other.inliers.tolist() == [False, True] * 3


def test_confidence_weighs_the_inliers():
    # Two points up, two down, one far off.
    body = 0.03 * np.array([[1.0, 1, 0], [1, -1, 0], [-1, 1, 0], [-1, -1, 0], [0, 0, 1]])
    points = body + np.array([[0, 0, 0.001]] * 2 + [[0, 0, -0.001]] * 2 + [[0.1, 0, 0]])
    reference = resting_reference(body)

    output = dut(points, reference, BcsdmConfig(), np.array([1.0, 1.0, 0.25, 0.25, 1.0]))

    assert output.inliers.tolist() == [True] * 4 + [False]
    assert output.v[2] == pytest.approx(-3.0 * 0.001 * (2.0 - 0.5) / 2.5)


@pytest.mark.parametrize("off", [0.015, 0.03])
@pytest.mark.parametrize("eta", [0.1, 1.0, 10.0])
def test_outliers_are_found_by_distance_for_any_gain(eta, off):
    points = STRAIGHT.positions[4].copy()
    points[2] += [0.0, 0.0, off]
    points[4] += [0.0, 0.0, 0.002]

    output = dut(points, STRAIGHT, BcsdmConfig(eta=eta))

    assert output.inliers.tolist() == [True, True, False, True, True, True]


@pytest.mark.parametrize(
    "config",
    [
        BcsdmConfig(inlier_distance=0.02),
        BcsdmConfig(eta=3.0, outlier_test="velocity", inlier_speed=0.06),
    ],
)
def test_threshold_of_outliers_can_be_set(config):
    points = BODY.copy()
    points[2] += [0.0, 0.0, 0.05]
    points[4] += [0.0, 0.0, 0.01]

    output = dut(points, resting_reference(BODY), config)

    assert output.inliers.tolist() == [True, True, False, True, True, True]


def test_outliers_are_determined_by_the_closest_configuration_and_not_by_the_end():
    # Five points are where the first sample has them, and not as the last has them.
    positions = np.stack([BODY, BODY, BODY])
    positions[2, 4:] += [[0.05, 0.0, 0.0], [0.0, 0.04, 0.0]]
    points = BODY.copy()
    points[2] += [0.0, 0.0, 0.02]

    output = dut(points, still_reference(positions), BcsdmConfig())

    assert output.inliers.tolist() == [True, True, False, True, True, True]


def test_progress_window_applies_after_outliers_are_removed():
    # Out along x and back over the same places.
    out = np.linspace(0.0, 0.1, 11)
    path = np.concatenate([out, out[-2::-1]])
    positions = BODY + path[:, None, None] * np.array([1.0, 0, 0])
    reference = still_reference(positions, 0.25)
    config = BcsdmConfig(progress_window=(0.5, 0.5))
    points = BODY + np.array([0.05, 0.0, 0.0])
    points[2] += [0.0, 0.0, 0.05]

    there, back = (dut(points, reference, config, previous_tau=tau) for tau in (1.2, 3.8))

    assert there.tau == pytest.approx(1.25)
    assert back.tau == pytest.approx(3.75)


def test_a_mirror_image_is_no_rigid_motion():
    # Eight points in a plane and one off it, which a mirror would bring to its place.
    angles = np.arange(8) * 0.7
    plane = 0.03 * np.stack([np.cos(angles), np.sin(angles) * (1.0 + 0.1 * angles), 0.0 * angles])
    body = np.vstack([plane.T, [[0.0, 0.0, 0.02]]])
    points = body * [1.0, 1.0, -1.0]

    output = dut(points, resting_reference(body), BcsdmConfig())

    assert output.inliers.tolist() == [True] * 8 + [False]
