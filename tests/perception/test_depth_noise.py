import cv2
import numpy as np
import pytest

from poil_drake.errors import InvalidValueError
from poil_drake.perception.depth_noise import StereoDepthNoiseConfig
from poil_drake.perception.depth_noise import apply_stereo_depth_noise as dut

EXACT = {"inverse_depth_step": 0.0, "blob_count": 0.0}
QUIET = EXACT | {"flying_probability": 0.0, "hole_probability": 0.0, "quadratic": 0.0}
SHAPE = (240, 320)


def wall(depth):
    return np.full(SHAPE, depth, dtype=np.float32)


def step_edge(near=0.6, far=1.0):
    """Returns depth whose left half is near."""
    depth = wall(far)
    depth[:, :160] = near
    return depth


def distance_from_step():
    """Returns distances (W,) from the edge [px]: 1 beside it, on both sides."""
    columns = np.arange(320)
    return np.where(columns < 160, 160 - columns, columns - 159)


def test_deviation_grows_with_the_square_of_the_depth():
    config = StereoDepthNoiseConfig(**EXACT, quadratic=0.0015)
    depths = np.array([0.3, 0.6, 1.2, 2.4])

    deviations = [np.std(dut(wall(z), config, (0, 0, k)) - z) for k, z in enumerate(depths)]

    slope, intercept = np.polyfit(np.log(depths), np.log(deviations), 1)
    assert slope == pytest.approx(2.0, abs=0.02)
    assert np.exp(intercept) == pytest.approx(0.0015, rel=0.02)


def test_noise_has_no_bias_and_one_deviation_everywhere():
    config = StereoDepthNoiseConfig(**EXACT)

    errors = np.stack([dut(wall(1.0), config, (5, k)) - 1.0 for k in range(200)])

    assert abs(np.mean(errors)) < 1e-5
    # From 200 samples a deviation is known to 5 %; the extremes of many pixels lie at five times
    # that. A column of 240 pixels, of which neighbours err together, is known to a percent.
    deviations = np.std(errors, axis=0)
    assert np.max(np.abs(deviations / 0.0015 - 1.0)) < 0.3
    columns = np.sqrt(np.mean(deviations**2, axis=0))
    assert np.max(np.abs(columns / 0.0015 - 1.0)) < 0.03


@pytest.mark.parametrize("pitch", [1, 3, 8])
def test_errors_of_neighbours_are_correlated_up_to_twice_the_pitch(pitch):
    config = StereoDepthNoiseConfig(**EXACT, correlation_length=pitch)
    errors = np.concatenate([dut(wall(1.0), config, (1, k)) - 1.0 for k in range(10)])

    def correlation(lag):
        return np.corrcoef(errors[:, lag:].ravel(), errors[:, :-lag].ravel())[0, 1]

    assert abs(correlation(2 * pitch)) < 0.02
    if pitch > 1:
        assert correlation(1) > 0.5
    else:
        assert abs(correlation(1)) < 0.02


def test_same_seed_gives_the_same_bits_and_another_frame_or_camera_does_not():
    config, depth = StereoDepthNoiseConfig(), step_edge()
    first = dut(depth, config, (1, 0, 7))

    np.testing.assert_array_equal(depth, step_edge())
    np.testing.assert_array_equal(dut(step_edge(), config, (1, 0, 7)), first)
    for other in ((1, 0, 8), (1, 1, 7), (2, 0, 7)):
        assert not np.array_equal(dut(step_edge(), config, other), first)


def test_depth_is_a_whole_number_of_steps_of_inverse_depth():
    config = StereoDepthNoiseConfig(inverse_depth_step=0.01, blob_count=0.0)

    steps = 1.0 / dut(wall(0.65), config, 0).astype(float) / 0.01

    np.testing.assert_allclose(steps, np.round(steps), atol=1e-4)


def test_invalid_and_far_and_near_pixels_are_zero():
    depth = wall(1.0)
    depth[0, :5] = [0.0, np.inf, np.nan, 0.1, 9.0]
    config = StereoDepthNoiseConfig(**QUIET, min_depth=0.2, max_depth=5.0)

    noisy = dut(depth, config, 0)

    assert noisy.dtype == np.float32
    assert noisy[0, :5].tolist() == [0.0] * 5
    np.testing.assert_allclose(noisy[1:], 1.0, rtol=1e-6)


def test_holes_are_on_the_farther_side_of_edges_and_nowhere_else():
    config = StereoDepthNoiseConfig(**(QUIET | {"hole_probability": 0.5}), hole_width=3)

    holes = dut(step_edge(), config, 0) == 0.0

    shadow = (np.arange(320) >= 160) & (distance_from_step() <= 3)
    assert not holes[:, ~shadow].any()
    assert np.mean(holes[:, shadow]) == pytest.approx(0.5, abs=0.06)


def test_pixels_fly_between_the_surfaces_of_an_edge_and_nowhere_else():
    config = StereoDepthNoiseConfig(**(QUIET | {"flying_probability": 0.25}), flying_width=1)

    noisy = dut(step_edge(0.6, 1.0), config, 0)

    flying = np.abs(noisy - step_edge(0.6, 1.0)) > 1e-6
    beside = distance_from_step() <= 1
    assert not flying[:, ~beside].any()
    assert np.mean(flying[:, beside]) == pytest.approx(0.25, abs=0.06)
    assert np.all((noisy[flying] > 0.6 - 1e-6) & (noisy[flying] < 1.0 + 1e-6))
    assert np.mean(noisy[flying]) == pytest.approx(0.8, abs=0.05)


def test_small_steps_are_not_edges():
    certain = {"hole_probability": 1.0, "flying_probability": 1.0}
    config = StereoDepthNoiseConfig(**(QUIET | certain), edge_jump=0.03)

    np.testing.assert_allclose(
        dut(step_edge(1.0, 1.02), config, 0), step_edge(1.0, 1.02), rtol=1e-6
    )


def test_blobs_have_the_configured_number_and_size():
    config = StereoDepthNoiseConfig(**(QUIET | {"blob_count": 2.0}), blob_radius=(3, 3))
    counts, sizes = [], []

    for frame in range(150):
        holes = (dut(wall(1.0), config, (3, frame)) == 0.0).astype(np.uint8)
        count, _, stats, _ = cv2.connectedComponentsWithStats(holes)
        counts.append(count - 1)
        sizes.extend(stats[1:, cv2.CC_STAT_AREA])

    # Poisson with mean 2 over 150 frames: a standard error of 0.12. A disc of radius 3 px.
    assert np.mean(counts) == pytest.approx(2.0, abs=0.4)
    assert np.median(sizes) == pytest.approx(np.pi * 3.0**2, rel=0.4)


def test_disabled_noise_only_marks_invalid_pixels():
    depth = step_edge()
    depth[3, 4] = np.inf
    expected = step_edge()
    expected[3, 4] = 0.0

    np.testing.assert_array_equal(dut(depth, StereoDepthNoiseConfig(enabled=False), 0), expected)


@pytest.mark.parametrize(
    "wrong",
    [
        {"min_depth": 0.0},
        {"max_depth": 0.1},
        {"blob_radius": (3, 2)},
        {"quadratic": np.inf},
        {"edge_jump": np.nan},
        {"hole_probability": 1.5},
        {"correlation_length": 0},
        {"flying_width": -1},
    ],
)
def test_an_error_names_an_invalid_parameter(wrong):
    with pytest.raises(InvalidValueError, match=next(iter(wrong))):
        StereoDepthNoiseConfig(**wrong)
