"""The judgement of detectors, on hand-made scenes, and one random scene."""

import numpy as np
import pytest

from poil_drake.benchmarks.detection import study
from poil_drake.benchmarks.detection.scenes import DetectionScene, MakeDetectionScene
from poil_drake.benchmarks.detection.study import Detection, judge_detector, summarize
from poil_drake.errors import DetectionError
from poil_drake.perception.detectors.protocol import PartMasks
from poil_drake.perception.images import CameraModel, MultiViewFrame, RgbdImage

SIZE = (40, 40)
# At a depth of 1 m, a pixel covers 1 mm.
CAMERA = CameraModel("left", 40, 40, np.diag([1000.0, 1000.0, 1.0]), np.eye(4))


class Found:
    """A detector that finds a part in 10 x 10 pixels."""

    def __init__(self, left: int):
        self.left = left

    def detect(self, frame: MultiViewFrame, *, object_label: str, part_label: str) -> PartMasks:
        mask = np.zeros(SIZE, dtype=bool)
        mask[:10, self.left : self.left + 10] = True
        return PartMasks((mask,), (mask,))


class Refuses:
    def detect(self, frame: MultiViewFrame, *, object_label: str, part_label: str) -> PartMasks:
        raise DetectionError("It is hidden.", remedy="Turn it.")


def scene(part_columns: int) -> DetectionScene:
    """Returns a scene that shows the part in the first 10 rows of some columns."""
    label = np.full(SIZE, 3)
    label[:10, :part_columns] = 4
    image = RgbdImage(np.zeros((*SIZE, 3)), np.ones(SIZE), stamp=0.0, label=label)
    frame = MultiViewFrame((CAMERA,), (image,), {"mug": (3, 4), "mug/handle": (4,)})
    return DetectionScene(frame, "mug_a", lying=False, clutter=())


@pytest.mark.parametrize(("left", "verdict", "error"), [(4, "right", 0.004), (12, "wrong", 0.012)])
def test_a_part_is_right_within_a_centimetre(left: int, verdict: str, error: float) -> None:
    result = judge_detector("mine", Found(left), scene(10), seed=0)

    assert result.verdict == verdict
    assert result.error == pytest.approx(error)


@pytest.mark.parametrize(("columns", "verdict"), [(5, "rightly refused"), (6, "refused")])
def test_a_refusal_is_due_below_60_pixels(columns: int, verdict: str) -> None:
    result = judge_detector("mine", Refuses(), scene(columns), seed=0)

    assert result.verdict == verdict
    assert result.reason == "It is hidden."


def test_the_summary_has_the_share_of_each_verdict() -> None:
    results: list[Detection] = [
        *(judge_detector("mine", Found(left), scene(10), seed=left) for left in (0, 2, 12)),
        judge_detector("mine", Refuses(), scene(0), seed=9),
    ]

    row = summarize(results)["mine"]

    assert [row[verdict] for verdict in study.VERDICTS] == [0.5, 0.25, 0.0, 0.25]
    assert row["median_error"] == pytest.approx(0.001)


@pytest.mark.render
def test_a_seed_draws_one_scene() -> None:
    first, again, hidden = (MakeDetectionScene(0, hidden=h) for h in (False, False, True))

    for one, other in zip(first.frame.images, again.frame.images, strict=True):
        np.testing.assert_array_equal(one.depth, other.depth)
    assert len(hidden.frame.cameras) == 1
    assert hidden.part_pixels() < 20 < first.part_pixels()
