"""The models' real classes, with random weights, run whole; then known outputs replace theirs."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from tiny_models import (
    SAM2_SIDE,
    save_grounding_dino,
    save_rex_omni,
    save_sam2,
    save_sam3,
    saved,
)
from transformers import (
    AutoTokenizer,
    GroundingDinoForObjectDetection,
    Qwen2_5_VLForConditionalGeneration,
    Sam2Model,
    Sam3Model,
)

from poil_drake.perception.detectors.by_name.config import GroundingDino, RexOmni, Sam3
from poil_drake.perception.detectors.by_name.grounding_dino import GroundingDinoFinder
from poil_drake.perception.detectors.by_name.rex_omni import RexOmniFinder
from poil_drake.perception.detectors.by_name.sam3 import Sam3Finder
from poil_drake.perception.images import CameraModel, RgbdImage
from poil_drake.perception.segmenters.config import Sam2
from poil_drake.perception.segmenters.sam2 import Sam2Segmenter

HEIGHT, WIDTH = 90, 120
RGB = np.random.default_rng(0).integers(0, 255, (HEIGHT, WIDTH, 3), dtype=np.uint8)
RGBD = RgbdImage(RGB, np.ones((HEIGHT, WIDTH)), stamp=0.0)
CAMERA = CameraModel("left", WIDTH, HEIGHT, np.diag([100.0, 100.0, 1.0]), np.eye(4))
BOX = np.array([[30.0, 20.0, 70.0, 60.0]])


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch) -> Callable[..., list[dict]]:
    """Replaces fields of a model's output, and returns a list of the arguments of its calls."""

    def replace(model: type, **fields: torch.Tensor) -> list[dict]:
        seen: list[dict] = []
        forward = model.forward

        def replaced(self: object, **inputs: object) -> object:
            seen.append(inputs)
            output = forward(self, **inputs)
            for name, value in fields.items():
                assert output[name].shape[2:] == value.shape[2:], name
                output[name] = value
            return output

        monkeypatch.setattr(model, "forward", replaced)
        return seen

    return replace


def answer(text: str, folder: str, monkeypatch: pytest.MonkeyPatch) -> list[torch.nn.Module]:
    """Lets Rex-Omni answer with a text, after two tokens of its own; returns its models."""
    ids = AutoTokenizer.from_pretrained(folder)(text, return_tensors="pt")["input_ids"]
    models: list[torch.nn.Module] = []
    generate = Qwen2_5_VLForConditionalGeneration.generate

    def canned(self: torch.nn.Module, **inputs: object) -> torch.Tensor:
        models.append(self)
        own = generate(self, **{**inputs, "max_new_tokens": 2, "min_new_tokens": 2})
        return torch.hstack([own[:, :-2], ids])

    monkeypatch.setattr(Qwen2_5_VLForConditionalGeneration, "generate", canned)
    return models


def test_rex_omni_finds_the_boxes_that_it_names(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = saved(save_rex_omni, tmp_path)
    dut = RexOmniFinder(RexOmni(weights=folder, device="cpu"))
    text = (
        "<|object_ref_start|>handle<|object_ref_end|><|box_start|><0><111><333><999>,"
        "<999><222><666><0><|box_end|><|im_end|>"
    )
    models = answer(text, folder, monkeypatch)

    boxes = dut.find(RGB, "handle")

    np.testing.assert_allclose(boxes.corners, [[0, 10, 40, 90], [80, 0, 120, 20]])
    # In two dimensions the image reaches less far than its number of patches. Without them, the
    # model takes the patches for words, and this is None.
    assert models[0].model.rope_deltas.item() < 0


def test_grounding_dino_finds_boxes_with_scores(
    tmp_path: Path, calls: Callable[..., list[dict]]
) -> None:
    dut = GroundingDinoFinder(
        GroundingDino(weights=saved(save_grounding_dino, tmp_path), device="cpu")
    )
    logits = torch.full((1, 2, 256), -9.0)
    logits[0, 0, 1], logits[0, 1, 1] = 0.0, -2.0  # Scores 0.5 and 0.12.
    centred = torch.tensor([[[0.5, 0.5, 0.5, 0.2], [0.5, 0.5, 0.1, 0.1]]])
    seen = calls(GroundingDinoForObjectDetection, logits=logits, pred_boxes=centred)

    boxes = dut.find(RGB, "Mug")

    np.testing.assert_allclose(boxes.corners, [[30, 36, 90, 54]], atol=1e-4)
    np.testing.assert_allclose(boxes.scores, [0.5])
    assert seen[0]["input_ids"].tolist() == [[101, 7, 1012, 102]]  # "mug."


def test_sam3_finds_boxes_with_scores(tmp_path: Path, calls: Callable[..., list[dict]]) -> None:
    dut = Sam3Finder(Sam3(weights=saved(save_sam3, tmp_path), device="cpu"))
    seen = calls(
        Sam3Model,
        pred_logits=torch.tensor([[9.0, -0.5]]),
        pred_boxes=torch.tensor([[[0.25, 0.5, 0.75, 1.0], [0.0, 0.0, 1.0, 1.0]]]),
        presence_logits=torch.tensor([[0.0]]),  # A factor of 0.5.
    )

    boxes = dut.find(RGB, "mug handle")

    np.testing.assert_allclose(boxes.corners, [[30, 45, 90, 90]])
    np.testing.assert_allclose(boxes.scores, [0.5], atol=1e-3)
    assert seen[0]["attention_mask"].sum() == 2  # Two words, and padding.


def test_weights_are_read_from_the_folder(tmp_path: Path) -> None:
    config = Sam3(weights=saved(save_sam3, tmp_path), device="cpu", threshold=0.0)

    first, again = (Sam3Finder(config).find(RGB, "mug") for _ in range(2))

    # Weights that are not in the folder are drawn at random.
    assert len(first.corners)
    np.testing.assert_array_equal(first.corners, again.corners)


@pytest.fixture
def sam2(tmp_path: Path) -> Sam2Segmenter:
    return Sam2Segmenter(Sam2(weights=saved(save_sam2, tmp_path), device="cpu"))


def test_sam2_makes_one_connected_mask_for_each_box(
    sam2: Sam2Segmenter, calls: Callable[..., list[dict]]
) -> None:
    low = torch.full((1, 2, 1, SAM2_SIDE // 4, SAM2_SIDE // 4), -1.0)
    low[0, 0, 0, 8:16, 16:24] = 1.0  # From 1/4 to 1/2 of the height, 1/2 to 3/4 of the width.
    low[0, 0, 0, 30, 30] = 5.0
    seen = calls(Sam2Model, pred_masks=low)

    masks = sam2.segment(RGBD, CAMERA, np.vstack([BOX, BOX]))

    expected = np.zeros((HEIGHT, WIDTH), dtype=bool)
    expected[23:45, 60:90] = True  # The upper edge is at 22.5.
    assert np.count_nonzero(masks[0] != expected) <= 2 * (22 + 30)  # A pixel along the border.
    assert not masks[1].any()
    scaled = [[30 / 120, 20 / 90, 70 / 120, 60 / 90]]
    np.testing.assert_allclose(seen[0]["input_boxes"][0, :1], np.multiply(scaled, SAM2_SIDE))


def test_sam2_keeps_a_part_within_its_object(sam2: Sam2Segmenter) -> None:
    within = np.zeros((HEIGHT, WIDTH), dtype=bool)
    within[30:40, 40:50] = True

    mask = sam2.segment(RGBD, CAMERA, BOX, within)[0]

    assert not (mask & ~within).any()


def test_sam2_sees_an_image_once_for_several_questions(
    sam2: Sam2Segmenter, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen = []
    embed = Sam2Model.get_image_embeddings
    monkeypatch.setattr(
        Sam2Model,
        "get_image_embeddings",
        lambda self, pixels: seen.append(pixels) or embed(self, pixels),
    )

    for image in (RGBD, RGBD, RgbdImage(RGB[::-1], RGBD.depth, stamp=0.1)):
        sam2.segment(image, CAMERA, BOX)

    assert len(seen) == 2


def test_sam2_makes_no_masks_of_no_boxes(sam2: Sam2Segmenter) -> None:
    assert sam2.segment(RGBD, CAMERA, np.zeros((0, 4))).shape == (0, HEIGHT, WIDTH)
