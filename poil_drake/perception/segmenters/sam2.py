"""Masks by SAM 2, from transformers."""

from typing import Any

import numpy as np

from poil_drake.perception.images import CameraModel, RgbdImage
from poil_drake.perception.learned_models.learned_model import prepare_device
from poil_drake.perception.learned_models.square_input import square_input
from poil_drake.perception.segmenters.config import Sam2
from poil_drake.perception.segmenters.protocol import largest_component

_MEAN, _DEVIATION = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)  # ImageNet's


class Sam2Segmenter:
    """Turns boxes into masks by SAM 2; a `Segmenter`."""

    def __init__(self, config: Sam2):
        """Loads the model.

        Raises:
            MissingDependencyError: if transformers or the weights are missing.
        """
        folder = config.folder()
        import torch
        from transformers import Sam2Model

        self._device = prepare_device(config.device)
        self._model = Sam2Model.from_pretrained(folder, dtype=torch.float32, local_files_only=True)
        self._model.to(self._device).eval()
        # Almost all time goes into the image, about which an object and its part are asked.
        self._image: RgbdImage | None = None
        self._embeddings: Any = None
        self._side = self._model.config.prompt_encoder_config.image_size

    def segment(
        self,
        image: RgbdImage,
        camera: CameraModel,
        boxes: np.ndarray,
        within: np.ndarray | None = None,
    ) -> np.ndarray:
        """Returns masks (n, H, W) bool; see `Segmenter.segment`."""
        import torch

        height, width = image.depth.shape
        if not len(boxes):
            return np.zeros((0, height, width), dtype=bool)
        # The model sees a square, to which the image is stretched.
        scale = self._side / np.array([width, height, width, height])
        prompt = torch.tensor((boxes * scale)[None], dtype=torch.float32)
        with torch.inference_mode():
            if image is not self._image:
                pixels = square_input(image.rgb, self._side, _MEAN, _DEVIATION).to(self._device)
                self._embeddings = self._model.get_image_embeddings(pixels)
                self._image = image
            output = self._model(
                image_embeddings=self._embeddings,
                input_boxes=prompt.to(self._device),
                multimask_output=False,
            )
            logits = torch.nn.functional.interpolate(
                output.pred_masks[0].float(), size=(height, width), mode="bilinear"
            )
        masks = (logits[:, 0] > 0.0).cpu().numpy()
        if within is not None:
            masks &= within
        return np.stack([largest_component(mask) for mask in masks])
