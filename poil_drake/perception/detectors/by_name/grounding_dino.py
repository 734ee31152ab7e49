"""Finds boxes by Grounding DINO, from transformers."""

import numpy as np

from poil_drake.perception.detectors.by_name.config import GroundingDino
from poil_drake.perception.detectors.by_name.protocol import Boxes
from poil_drake.perception.learned_models.learned_model import prepare_device


class GroundingDinoFinder:
    """Finds boxes by Grounding DINO; a `BoxFinder`."""

    def __init__(self, config: GroundingDino):
        """Loads the model.

        Raises:
            MissingDependencyError: if transformers or the weights are missing.
        """
        folder = config.folder()
        import torch
        from transformers import (
            AutoImageProcessor,
            AutoTokenizer,
            GroundingDinoForObjectDetection,
            GroundingDinoProcessor,
        )

        self._threshold = config.threshold
        self._device = prepare_device(config.device)
        self._model = GroundingDinoForObjectDetection.from_pretrained(
            folder, dtype=torch.float32, local_files_only=True
        )
        self._model.to(self._device).eval()
        self._processor = GroundingDinoProcessor(
            AutoImageProcessor.from_pretrained(folder, backend="pil", local_files_only=True),
            AutoTokenizer.from_pretrained(folder, local_files_only=True),
        )

    def find(self, image: np.ndarray, label: str) -> Boxes:
        """Returns boxes with scores; see `BoxFinder.find`."""
        import torch

        size = image.shape[:2]
        # The model was trained with lower-case phrases that end with a full stop.
        inputs = self._processor(
            images=np.array(image), text=f"{label.lower()}.", return_tensors="pt"
        ).to(self._device)
        with torch.inference_mode():
            output = self._model(**inputs)
        [found] = self._processor.post_process_grounded_object_detection(
            output, inputs["input_ids"], threshold=self._threshold, target_sizes=[size]
        )
        return Boxes.in_image(found["boxes"].cpu(), size, found["scores"].cpu())
