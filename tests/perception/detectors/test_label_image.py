import numpy as np
import pytest

from poil_drake.errors import DetectionError
from poil_drake.perception.detectors.label_image import LabelImageDetector
from poil_drake.perception.detectors.protocol import PartMasks
from poil_drake.perception.images import CameraModel, MultiViewFrame, RgbdImage

SIZE = (12, 16)
CAMERA = CameraModel("left", 16, 12, np.diag([600.0, 600.0, 1.0]), np.eye(4))
COARSE = CameraModel("left", 16, 12, np.diag([300.0, 300.0, 1.0]), np.eye(4))
LABELS = {"mug": (3, 4), "mug/handle": (4,), "mug/rim": (9,), "rack": (7,)}


def detect(
    labels: list[np.ndarray | None],
    object_label: str = "mug",
    part_label: str = "handle",
    camera: CameraModel = CAMERA,
) -> PartMasks:
    """Detects a part, 1 m away, in one view for each label image."""
    images = tuple(
        RgbdImage(np.zeros((*SIZE, 3)), np.ones(SIZE), stamp=0.0, label=label) for label in labels
    )
    frame = MultiViewFrame((camera,) * len(labels), images, LABELS)
    return LabelImageDetector().detect(frame, object_label=object_label, part_label=part_label)


def label_image(handle_pixels: int) -> np.ndarray:
    label = np.full(SIZE, 7)
    label[:8] = 3
    label.ravel()[:handle_pixels] = 4
    return label


def test_masks_are_those_of_the_labels() -> None:
    labels = [label_image(60), label_image(0)]

    masks = detect(labels)

    for k, label in enumerate(labels):
        np.testing.assert_array_equal(masks.part_masks[k], label == 4)
        np.testing.assert_array_equal(masks.object_masks[k], (label == 3) | (label == 4))


def test_frames_without_labels_are_rejected() -> None:
    with pytest.raises(DetectionError, match="needs render labels"):
        detect([None, None])


@pytest.mark.parametrize("labelled", [0, 1])
def test_a_view_without_labels_has_empty_masks(labelled: int) -> None:
    labels: list[np.ndarray | None] = [None, None]
    labels[labelled] = label_image(60)

    masks = detect(labels)

    np.testing.assert_array_equal(masks.part_masks[labelled], labels[labelled] == 4)
    for mask in (masks.part_masks[1 - labelled], masks.object_masks[1 - labelled]):
        assert mask.shape == SIZE
        assert not mask.any()


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
        detect([label_image(9)], object_label, part_label)


def test_a_part_of_too_few_pixels_is_not_seen() -> None:
    with pytest.raises(DetectionError, match=r"59 pixels.* 60 are needed"):
        detect([label_image(40), label_image(19)])


def test_other_labels_than_the_parts_are_listed() -> None:
    with pytest.raises(DetectionError, match=r"0 pixels.*has the label 4; there are 0, 255\."):
        detect([np.where(label_image(70) == 4, 255, 0)])


def test_fewer_coarse_pixels_are_enough() -> None:
    assert detect([label_image(15)], camera=COARSE).part_masks[0].sum() == 15
    with pytest.raises(DetectionError, match=r"14 pixels.* 15 are needed"):
        detect([label_image(10), label_image(4)], camera=COARSE)
