import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import Context
from pydrake.systems.sensors import ImageDepth32F

from poil_drake.perception.depth_noise import StereoDepthNoiseConfig, apply_stereo_depth_noise
from poil_drake.systems.cameras.depth_noise import DepthNoiseSystem

WIDTH, HEIGHT = 64, 48


def make(*, camera_index: int = 0, enabled: bool = True) -> DepthNoiseSystem:
    return DepthNoiseSystem(
        width=WIDTH,
        height=HEIGHT,
        config=StereoDepthNoiseConfig(enabled=enabled),
        seed=3,
        camera_index=camera_index,
    )


def depth() -> np.ndarray:
    ramp = np.tile(np.linspace(0.5, 1.0, WIDTH, dtype=np.float32), (HEIGHT, 1))
    ramp[0, :4] = np.inf
    ramp[1, :4] = 0.0
    return ramp


def context_at(dut: DepthNoiseSystem, time: float) -> Context:
    image = ImageDepth32F(WIDTH, HEIGHT)
    image.mutable_data[:, :, 0] = depth()
    context = dut.CreateDefaultContext()
    context.SetTime(time)
    dut.GetInputPort("depth_image").FixValue(context, Value(image))
    return context


def look(dut: DepthNoiseSystem, time: float) -> np.ndarray:
    return dut.get_output_port().Eval(context_at(dut, time)).data[:, :, 0].copy()


def test_the_noise_is_that_of_the_function() -> None:
    expected = apply_stereo_depth_noise(depth(), StereoDepthNoiseConfig(), (3, 1, 250_000))

    np.testing.assert_array_equal(look(make(camera_index=1), 0.25), expected)


def test_looking_twice_at_one_time_shows_the_same() -> None:
    np.testing.assert_array_equal(look(make(), 0.25), look(make(), 0.25))


def test_other_times_and_cameras_have_other_noise() -> None:
    first = look(make(), 0.25)

    assert np.any(first != look(make(), 0.375))
    assert np.any(first != look(make(camera_index=1), 0.25))


def test_time_going_on_renews_a_cached_image() -> None:
    dut = make()
    context = context_at(dut, 0.25)
    first = dut.get_output_port().Eval(context).data.copy()
    context.SetTime(0.5)

    assert np.any(first != dut.get_output_port().Eval(context).data)


def test_switched_off_it_still_clears_what_was_not_measured() -> None:
    seen = look(make(enabled=False), 0.0)

    assert np.all(seen[:2, :4] == 0)
    np.testing.assert_array_equal(seen[2:], depth()[2:])


def test_what_is_not_a_number_becomes_zero() -> None:
    dut = make()
    context = context_at(dut, 0.0)
    image = ImageDepth32F(WIDTH, HEIGHT)
    image.mutable_data[:] = 0.7
    image.mutable_data[10:20, 10:20] = np.nan
    dut.GetInputPort("depth_image").FixValue(context, Value(image))

    noisy = dut.get_output_port().Eval(context).data[:, :, 0]

    assert np.all(np.isfinite(noisy))
    assert np.all(noisy[10:20, 10:20] == 0.0)


def test_the_image_passes_through_within_an_instant() -> None:
    # By design: it is a camera's last stage, and a camera has no state.
    assert make().HasDirectFeedthrough(0, 0)
    assert make().num_discrete_state_groups() == make().num_abstract_states() == 0
