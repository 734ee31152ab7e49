from pathlib import Path

import numpy as np
import pytest
from block_scene import HANDLE, OBJECT, TABLE, Scene, make_scene

from poil_drake.errors import DetectionError, LabelError
from poil_drake.perception.detectors.by_hand.detector import HandLabelDetector, hand_label_masks
from poil_drake.perception.detectors.by_hand.hand_labels import BOX, HandLabels, Mark

DEMONSTRATED = make_scene()
TARGET = make_scene({"table": TABLE, "object": OBJECT, "handle": HANDLE})
NAMES = {"object_label": "mug", "part_label": "handle"}


def labelled(scene: Scene, path: Path, *roles: str) -> HandLabels:
    """Saves and returns labels of a scene with a box for each of the roles."""
    blocks = {"object": ("object", "handle"), "part": ("handle",)}
    labels = HandLabels.of(scene.frame).with_marks(
        Mark(view="left", role=role, kind=BOX, at=scene.box("left", *blocks[role]))
        for role in roles
    )
    labels.save(path)
    return labels


def test_the_detector_takes_the_labels_of_the_scene_that_it_sees(tmp_path: Path) -> None:
    paths = [tmp_path / "demo.labels.json", tmp_path / "scene.labels.json"]
    labelled(DEMONSTRATED, paths[0], "object", "part")
    labels = labelled(TARGET, paths[1], "object", "part")
    dut = HandLabelDetector(paths)

    found = dut.detect(TARGET.frame, **NAMES)

    expected = hand_label_masks(TARGET.frame, labels)
    for masks, role in ((found.object_masks, "object"), (found.part_masks, "part")):
        np.testing.assert_array_equal(masks, list(expected[role].values()))


def test_labels_of_another_scene_are_refused_by_name(tmp_path: Path) -> None:
    path = tmp_path / "demo.labels.json"
    labelled(DEMONSTRATED, path, "object", "part")
    dut = HandLabelDetector([path])

    with pytest.raises(DetectionError, match=r"demo\.labels\.json' \(left, right\).*poil label"):
        dut.detect(TARGET.frame, **NAMES)


@pytest.mark.parametrize(("roles", "missing"), [((), "object, 'mug'"), (("object",), "part, 'mug")])
def test_a_missing_mark_is_named(tmp_path: Path, roles: tuple[str, ...], missing: str) -> None:
    path = tmp_path / "scene.labels.json"
    labelled(TARGET, path, *roles)
    dut = HandLabelDetector([path])

    with pytest.raises(DetectionError, match=rf"mark no pixel of the {missing}"):
        dut.detect(TARGET.frame, **NAMES)


def test_a_missing_file_is_noticed_at_the_start(tmp_path: Path) -> None:
    with pytest.raises(LabelError):
        HandLabelDetector([tmp_path / "none.json"])
