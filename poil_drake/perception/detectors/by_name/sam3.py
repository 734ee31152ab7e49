"""Finds boxes by SAM 3, from transformers."""

import numpy as np

from poil_drake.perception.detectors.by_name.config import Sam3
from poil_drake.perception.detectors.by_name.protocol import Boxes
from poil_drake.perception.learned_models.learned_model import prepare_device
from poil_drake.perception.learned_models.square_input import square_input

_MEAN = _DEVIATION = (0.5, 0.5, 0.5)
_WORDS = 32  # Length to which names are padded, in tokens.


class Sam3Finder:
    """Finds boxes by SAM 3, around the masks that it makes of a phrase; a `BoxFinder`."""

    def __init__(self, config: Sam3):
        """Loads the model.

        Raises:
            MissingDependencyError: if transformers or the weights are missing.
        """
        folder = config.folder()
        import torch
        from transformers import AutoTokenizer, Sam3Model

        self._threshold = config.threshold
        self._device = prepare_device(config.device)
        self._model = Sam3Model.from_pretrained(folder, dtype=torch.float32, local_files_only=True)
        self._model.to(self._device).eval()
        self._tokenizer = AutoTokenizer.from_pretrained(folder, local_files_only=True)
        self._side = self._model.config.vision_config.backbone_config.image_size

    def find(self, image: np.ndarray, label: str) -> Boxes:
        """Returns boxes with scores; see `BoxFinder.find`."""
        import torch

        height, width = image.shape[:2]
        text = self._tokenizer(
            label, return_tensors="pt", padding="max_length", truncation=True, max_length=_WORDS
        ).to(self._device)
        pixels = square_input(image, self._side, _MEAN, _DEVIATION).to(self._device)
        with torch.inference_mode():
            output = self._model(
                pixel_values=pixels,
                input_ids=text["input_ids"],
                attention_mask=text["attention_mask"],
            )
        # A box counts if its query matches the phrase, and the phrase is in the image at all.
        scores = (output.pred_logits[0].sigmoid() * output.presence_logits[0].sigmoid()).cpu()
        keep = scores > self._threshold
        corners = output.pred_boxes[0].cpu()[keep] * torch.tensor([width, height, width, height])
        return Boxes.in_image(corners, (height, width), scores[keep])
