import numpy as np
import pytest

from poil_drake.errors import DetectionError
from poil_drake.perception.detectors.label_image import (
    LabelImageDetector,
    LabelImageDetectorConfig,
)
from poil_drake.perception.images import CameraModel, MultiViewFrame, RgbdImage

LABELS = {"mug": (3, 4), "mug/handle": (4,), "mug/rim": (9,), "rack": (7,)}


def frame(labels: list[np.ndarray | None], label_ids: dict | None = None) -> MultiViewFrame:
    K = np.array([[10.0, 0.0, 3.5], [0.0, 10.0, 2.5], [0.0, 0.0, 1.0]])
    cameras = tuple(CameraModel(f"camera{i}", 8, 6, K, np.eye(4)) for i in range(len(labels)))
    images = tuple(
        RgbdImage(np.zeros((6, 8, 3)), np.ones((6, 8)), stamp=0.0, label=label) for label in labels
    )
    return MultiViewFrame(cameras, images, LABELS if label_ids is None else label_ids)


def label_image(handle_pixels: int) -> np.ndarray:
    label = np.full((6, 8), 7)
    label[:4] = 3
    label.ravel()[:handle_pixels] = 4
    return label


def test_masks_are_those_of_the_labels() -> None:
    labels = [label_image(5), label_image(0)]
    dut = LabelImageDetector(LabelImageDetectorConfig(min_part_pixels=5))

    masks = dut.detect(frame(labels), object_label="mug", part_label="handle")

    for k, label in enumerate(labels):
        np.testing.assert_array_equal(masks.part_masks[k], label == 4)
        np.testing.assert_array_equal(masks.object_masks[k], (label == 3) | (label == 4))


def test_frames_without_labels_are_refused() -> None:
    with pytest.raises(DetectionError, match="no render labels"):
        LabelImageDetector().detect(frame([None, None]), object_label="mug", part_label="handle")


def test_a_view_without_labels_is_refused() -> None:
    with pytest.raises(DetectionError, match="no render labels"):
        LabelImageDetector().detect(
            frame([label_image(5), None]), object_label="mug", part_label="handle"
        )


def test_an_unknown_object_suggests_the_closest() -> None:
    with pytest.raises(DetectionError, match=r"no object 'mugg'.*'mug'\?.*Known: mug, rack"):
        LabelImageDetector().detect(
            frame([label_image(9)]), object_label="mugg", part_label="handle"
        )


def test_an_unknown_part_lists_the_parts_of_its_object() -> None:
    with pytest.raises(DetectionError, match=r"no part 'handel'.*'handle'\?.*Known: handle, rim"):
        LabelImageDetector().detect(
            frame([label_image(9)]), object_label="mug", part_label="handel"
        )


def test_an_object_without_parts_says_so() -> None:
    with pytest.raises(DetectionError, match="Known: none"):
        LabelImageDetector().detect(
            frame([label_image(9)]), object_label="rack", part_label="handle"
        )


def test_a_part_of_too_few_pixels_is_not_seen() -> None:
    dut = LabelImageDetector(LabelImageDetectorConfig(min_part_pixels=8))

    with pytest.raises(DetectionError, match="7 pixels of 8"):
        dut.detect(frame([label_image(4), label_image(3)]), object_label="mug", part_label="handle")
