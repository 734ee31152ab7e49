import numpy as np
import PIL.Image
import pytest

from poil_drake.perception.learned_models.square_input import square_input as dut

MEAN, DEVIATION = (0.5, 0.4, 0.3), (0.2, 0.25, 0.3)


@pytest.mark.parametrize("side", [50, 200])
def test_an_image_is_stretched_as_by_pillow(side: int) -> None:
    rgb = np.random.default_rng(0).integers(0, 255, (90, 120, 3), dtype=np.uint8)
    bilinear = PIL.Image.Resampling.BILINEAR
    expected = np.asarray(PIL.Image.fromarray(rgb).resize((side, side), bilinear))

    tensor = dut(rgb, side, MEAN, DEVIATION)

    assert tensor.shape == (1, 3, side, side)
    levels = 255 * (tensor[0].permute(1, 2, 0).numpy() * DEVIATION + MEAN)
    np.testing.assert_allclose(levels, expected, atol=1.01)  # They may round differently.
