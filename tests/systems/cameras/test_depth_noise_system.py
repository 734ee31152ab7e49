import numpy as np
import pytest
from pydrake.systems.sensors import ImageDepth32F
from system_bench import SystemBench

from poil_drake.perception.depth_noise import StereoDepthNoiseConfig, apply_stereo_depth_noise
from poil_drake.systems.cameras.depth_noise import DepthNoiseSystem

WIDTH, HEIGHT = 64, 48


def depth() -> np.ndarray:
    """Returns a ramp [m] with unmeasured pixels in its first three rows."""
    ramp = np.tile(np.linspace(0.5, 1.0, WIDTH, dtype=np.float32), (HEIGHT, 1))
    ramp[0, :4] = np.inf
    ramp[1, :4] = 0.0
    ramp[2, :4] = np.nan
    return ramp


def make_bench(config: StereoDepthNoiseConfig, *, camera_index: int = 0) -> SystemBench:
    dut = DepthNoiseSystem(
        width=WIDTH, height=HEIGHT, config=config, seed=3, camera_index=camera_index
    )
    image = ImageDepth32F(WIDTH, HEIGHT)
    image.mutable_data[:, :, 0] = depth()
    return SystemBench(dut, depth_image=image)


@pytest.mark.parametrize(("camera_index", "enabled"), [(0, True), (1, True), (0, False)])
def test_the_noise_at_each_time_is_that_of_the_function(camera_index: int, enabled: bool) -> None:
    config = StereoDepthNoiseConfig(enabled=enabled)
    bench = make_bench(config, camera_index=camera_index)

    for microseconds in (250_000, 500_000):
        bench.context.SetTime(1e-6 * microseconds)

        expected = apply_stereo_depth_noise(depth(), config, (3, camera_index, microseconds))
        np.testing.assert_array_equal(bench.read("noisy_depth_image")[:, :, 0], expected)


def test_the_image_passes_through_within_an_instant() -> None:
    # By design: the system is the last stage of a camera, which has no state.
    dut = make_bench(StereoDepthNoiseConfig()).dut
    assert dut.HasDirectFeedthrough(0, 0)
    assert dut.num_discrete_state_groups() == dut.num_abstract_states() == 0
