"""Adds a stereo camera's noise to a rendered depth image."""

from collections.abc import Callable

import numpy as np
from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import Context, LeafSystem
from pydrake.systems.sensors import ImageDepth32F

from poil_drake.perception.depth_noise import StereoDepthNoiseConfig, apply_stereo_depth_noise


class DepthNoiseSystem(LeafSystem):
    """Adds a stereo camera's errors to a depth image.

    .. pydrake_system::

        name: DepthNoiseSystem
        input_ports:
        - depth_image
        output_ports:
        - noisy_depth_image

    Both ports carry ImageDepth32F [m]. The output depends on the input image, the seed, the
    camera's index and the time. Invalid depths (NaN, infinite or negative) become 0. If the depth
    camera stands beside the colour camera, the output is registered to colour.
    """

    def __init__(
        self,
        *,
        width: int,
        height: int,
        config: StereoDepthNoiseConfig,
        seed: int,
        camera_index: int,
        register: Callable[[np.ndarray], np.ndarray] | None = None,
    ):
        """Constructs the system.

        Args:
            width: Width of the images [px].
            height: Height of the images [px].
            config: The errors to add.
            seed: Seed of the noise.
            camera_index: The camera's index. Cameras with different indices get different noise.
            register: Returns depth (H, W) [m] in the view of the colour camera; None if it is.
        """
        super().__init__()
        self._register = register
        self._config, self._seed, self._camera_index = config, seed, camera_index
        self._input = self.DeclareAbstractInputPort("depth_image", Value(ImageDepth32F()))
        self.DeclareAbstractOutputPort(
            "noisy_depth_image",
            lambda: Value(ImageDepth32F(width, height)),
            self._calc,
            {self._input.ticket(), self.time_ticket()},
        )

    def noisy(self, depth: np.ndarray, time: float) -> np.ndarray:
        """Returns `depth` (H, W) [m] with the camera's errors at `time` [s], registered."""
        microseconds = max(0, round(time * 1e6))
        noisy = apply_stereo_depth_noise(
            depth, self._config, (self._seed, self._camera_index, microseconds)
        )
        return noisy if self._register is None else self._register(noisy)

    def _calc(self, context: Context, output: AbstractValue) -> None:
        depth = self._input.Eval(context).data[:, :, 0]
        output.get_mutable_value().mutable_data[:, :, 0] = self.noisy(depth, context.get_time())
