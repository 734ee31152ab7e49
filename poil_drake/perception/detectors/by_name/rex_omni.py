"""Finds boxes by Rex-Omni, a Qwen2.5-VL that writes coordinates as tokens."""

import re

import numpy as np

from poil_drake.perception.detectors.by_name.config import RexOmni
from poil_drake.perception.detectors.by_name.protocol import Boxes
from poil_drake.perception.learned_models.learned_model import prepare_device

_PROMPT = (
    "<|im_start|>system\nYou are a helpful assistant<|im_end|>\n"
    "<|im_start|>user\n<|vision_start|>{image}<|vision_end|>Detect {label}. "
    "Output the bounding box coordinates in [x0, y0, x1, y1] format.<|im_end|>\n"
    "<|im_start|>assistant\n"
)
_IMAGE_TOKEN = "<|image_pad|>"

_PIXELS = {"shortest_edge": 16 * 28**2, "longest_edge": 1280 * 28**2}
"""Least and most pixels of the image that the model sees. More overflow a GPU of 16 GB."""

_MOST_TOKENS = 512
"""A box has about 10 tokens. On textured images the model may repeat boxes without end."""

_REPETITION_PENALTY = 1.05

_BINS = 999.0  # Coordinates are from 0 to 999, relative to the image.


class RexOmniFinder:
    """Finds boxes by Rex-Omni, which gives no scores; a `BoxFinder`."""

    def __init__(self, config: RexOmni):
        """Loads the model.

        Raises:
            MissingDependencyError: if transformers or the weights are missing.
        """
        folder = config.folder()
        import torch
        from transformers import (
            AutoImageProcessor,
            AutoTokenizer,
            Qwen2_5_VLForConditionalGeneration,
        )

        self._device = prepare_device(config.device)
        dtype = torch.float32 if self._device == "cpu" else torch.bfloat16
        self._model = Qwen2_5_VLForConditionalGeneration.from_pretrained(
            folder, dtype=dtype, attn_implementation="sdpa", local_files_only=True
        )
        self._model.to(self._device).eval()
        self._tokenizer = AutoTokenizer.from_pretrained(folder, local_files_only=True)
        # The whole processor needs torchvision, if only for videos.
        self._images = AutoImageProcessor.from_pretrained(
            folder, backend="pil", local_files_only=True
        )

    def find(self, image: np.ndarray, label: str) -> Boxes:
        """Returns boxes of equal scores; see `BoxFinder.find`."""
        import torch

        inputs = dict(self._images(images=np.array(image), size=_PIXELS, return_tensors="pt"))
        tokens = int(inputs["image_grid_thw"].prod()) // self._images.merge_size**2
        prompt = _PROMPT.format(image=_IMAGE_TOKEN * tokens, label=label)
        text = self._tokenizer(prompt, return_tensors="pt")
        ids = inputs["input_ids"] = text["input_ids"]
        inputs["attention_mask"] = text["attention_mask"]
        # Without it, the model silently takes the image's patches for a row of words.
        image_id = self._tokenizer.convert_tokens_to_ids(_IMAGE_TOKEN)
        inputs["mm_token_type_ids"] = (ids == image_id).int()
        with torch.inference_mode():
            output = self._model.generate(
                **{name: value.to(self._device) for name, value in inputs.items()},
                max_new_tokens=_MOST_TOKENS,
                do_sample=False,
                repetition_penalty=_REPETITION_PENALTY,
            )
        answer = self._tokenizer.decode(output[0, ids.shape[1] :], skip_special_tokens=False)
        return parse_answer(answer, image.shape[:2])


def parse_answer(answer: str, size: tuple[int, int]) -> Boxes:
    """Returns the boxes in an answer of Rex-Omni.

    An answer is `<|object_ref_start|>mug<|object_ref_end|><|box_start|><35><120><210><640>,
    <646><0><999><940><|box_end|>`, with "None" in place of boxes if nothing is seen. Points and
    polygons, which have other than four numbers, are ignored, and so is the last box of an answer
    that is cut off. Names are ignored, because one thing is asked for.

    Args:
        answer: The text with its special tokens.
        size: Height and width of the image that was asked about [px].
    """
    height, width = size
    corners = []
    for group in re.findall(
        r"<\|box_start\|>(.*?)(?:<\|box_end\|>|<\|object_ref_start\|>|$)", answer, re.S
    ):
        for box in group.split(","):
            numbers = [int(number) for number in re.findall(r"<\s*(\d+)\s*>", box)]
            if len(numbers) == 4 and max(numbers) <= _BINS:
                corners.append(numbers)
    scale = np.array([width, height, width, height]) / _BINS
    return Boxes.in_image(np.array(corners).reshape(-1, 4) * scale, size)
