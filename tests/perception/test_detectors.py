import numpy as np
import pytest

from poil_drake.errors import DetectionError, InvalidValueError
from poil_drake.perception.detectors import LabelImageDetector, make_detector
from poil_drake.perception.images import CameraModel, MultiViewFrame, RgbdImage

SIZE = (12, 16)
LABELS = {"mug": (3, 4), "mug/handle": (4,), "mug/rim": (9,), "rack": (7,)}


def frame(labels: list[np.ndarray | None], label_ids: dict | None = None) -> MultiViewFrame:
    height, width = SIZE
    cameras = tuple(CameraModel(f"{i}", width, height, np.eye(3), np.eye(4)) for i in range(2))
    images = tuple(
        RgbdImage(np.zeros((*SIZE, 3)), np.ones(SIZE), stamp=0.0, label=label) for label in labels
    )
    return MultiViewFrame(
        cameras[: len(images)], images, LABELS if label_ids is None else label_ids
    )


def label_image(handle_pixels: int) -> np.ndarray:
    label = np.full(SIZE, 7)
    label[:8] = 3
    label.ravel()[:handle_pixels] = 4
    return label


def test_masks_are_those_of_the_labels() -> None:
    labels = [label_image(60), label_image(0)]

    masks = LabelImageDetector().detect(frame(labels), object_label="mug", part_label="handle")

    for k, label in enumerate(labels):
        np.testing.assert_array_equal(masks.part_masks[k], label == 4)
        np.testing.assert_array_equal(masks.object_masks[k], (label == 3) | (label == 4))


@pytest.mark.parametrize("labels", [[None, None], [label_image(5), None]])
def test_frames_without_labels_are_rejected(labels: list[np.ndarray | None]) -> None:
    with pytest.raises(DetectionError, match="needs render labels"):
        LabelImageDetector().detect(frame(labels), object_label="mug", part_label="handle")


@pytest.mark.parametrize(
    ("object_label", "part_label", "problem"),
    [
        ("mugg", "handle", r"no render label for the object 'mugg'.*'mug'\?.*Known: mug, rack"),
        ("mug", "handel", r"the part 'handel' of 'mug'.*'handle'\?.*Known: handle, rim"),
        ("rack", "handle", "the part 'handle' of 'rack'.*Known: none"),
    ],
)
def test_an_unknown_name_suggests_the_closest_and_lists_the_known_ones(
    object_label: str, part_label: str, problem: str
) -> None:
    with pytest.raises(DetectionError, match=problem):
        LabelImageDetector().detect(
            frame([label_image(9)]), object_label=object_label, part_label=part_label
        )


def test_a_part_of_too_few_pixels_is_not_seen() -> None:
    seen = frame([label_image(40), label_image(19)])

    with pytest.raises(DetectionError, match=r"59 pixels.* 60 are needed"):
        LabelImageDetector().detect(seen, object_label="mug", part_label="handle")


def test_detectors_are_made_by_name() -> None:
    assert isinstance(make_detector("label_image"), LabelImageDetector)


def test_an_unknown_name_lists_the_known_ones() -> None:
    with pytest.raises(InvalidValueError, match=r"'owl'.*label_image"):
        make_detector("owl")
