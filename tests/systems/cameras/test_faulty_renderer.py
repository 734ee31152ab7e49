"""Faults injected into what simulated cameras render."""

from collections.abc import Mapping

import numpy as np

from poil_drake.perception.faults.delivery import DroppedFrames
from poil_drake.perception.faults.injector import FaultInjector
from poil_drake.perception.faults.surface import TransparentObject
from poil_drake.perception.images import CameraModel, RgbdImage
from poil_drake.systems.cameras.faulty_renderer import FaultyRenderer

CAMERAS = [CameraModel(n, 4, 3, np.diag([5.0, 5.0, 1.0]), np.eye(4)) for n in ("left", "right")]


class Painter:
    """A renderer in whose images depth is 1 m + the position; column 0 shows the mug."""

    def render(self, positions: np.ndarray, time: float) -> Mapping[str, RgbdImage]:
        depth = np.full((3, 4), 1.0 + positions[0], np.float32)
        rgb = np.zeros((3, 4, 3), np.uint8)
        return {name: RgbdImage(rgb, depth, time) for name in ("right", "left")}

    def render_labels(self, positions: np.ndarray, time: float) -> Mapping[str, np.ndarray]:
        label = np.zeros((3, 4), np.int16)
        label[:, 0] = 7
        return {name: label for name in ("right", "left")}


def make_dut(*faults: DroppedFrames | TransparentObject) -> FaultyRenderer:
    return FaultyRenderer(
        Painter(),
        injector=FaultInjector(faults, object_label="mug"),
        cameras=CAMERAS,
        label_ids={"mug": (7,)},
    )


def test_an_image_that_does_not_arrive_keeps_its_stamp() -> None:
    dut = make_dut(DroppedFrames(camera="left", start=0.5))

    dut.render(np.array([0.0]), 0.0)
    images = dut.render(np.array([1.0]), 1.0)

    assert (images["left"].stamp, images["left"].depth[0, 0]) == (0.0, 1.0)
    assert (images["right"].stamp, images["right"].depth[0, 0]) == (1.0, 2.0)


def test_faults_of_the_object_find_it_by_its_labels_but_deliver_none() -> None:
    dut = make_dut(TransparentObject(share=1.0))

    images = dut.render(np.array([0.0]), 0.0)

    assert images["left"].depth.tolist() == [[0.0, 1.0, 1.0, 1.0]] * 3
    assert images["left"].label is None
