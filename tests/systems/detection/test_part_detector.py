import threading

import numpy as np
import pytest
from pydrake.systems.sensors import ImageDepth32F, ImageLabel16I, ImageRgba8U
from system_bench import SystemBench

from poil_drake.errors import DetectionError
from poil_drake.geometry.depth_image import DepthMaskConfig
from poil_drake.geometry.rigid_transform import make_transform
from poil_drake.perception.detectors.protocol import PartMasks
from poil_drake.perception.fusion import FusionConfig, fuse_views
from poil_drake.perception.images import CameraModel, MultiViewFrame
from poil_drake.robots.panda_kinematics import PandaModel
from poil_drake.robots.panda_spheres import GRIPPER_LINK
from poil_drake.systems.absent import ABSENT
from poil_drake.systems.capture_timing import Worker
from poil_drake.systems.detection.part_detector import PartDetector
from poil_drake.systems.statuses import DetectorStatus

PERIOD = 1 / 8
W, H = 32, 24
CAMERA = CameraModel("left", W, H, np.diag([30.0, 30.0, 1.0]), np.eye(4))
# A small wall; the mask of a few hundred pixels is not filtered.
FUSION = FusionConfig(mask=DepthMaskConfig(), voxel_size=0.0, outlier_neighbours=0)


class MiddleDetector:
    """Finds the part in the middle of the image, unless it is dark there, once `go` is set."""

    def __init__(self) -> None:
        self.calls: list[tuple[float, str, str]] = []
        self.go = threading.Event()
        self.go.set()

    @property
    def searches(self) -> list[float]:
        return [stamp for stamp, _, _ in self.calls]

    def detect(self, frame: MultiViewFrame, *, object_label: str, part_label: str) -> PartMasks:
        self.go.wait()
        self.depth = frame.images[0].depth
        self.calls.append((frame.stamp, object_label, part_label))
        if frame.images[0].rgb[12, 16].max() < 50:
            raise DetectionError("It is dark.", remedy="Light a lamp.")
        mask = np.zeros((H, W), dtype=bool)
        mask[4:20, 6:26] = True
        return PartMasks(object_masks=(mask,), part_masks=(mask,))


def wall(*, brightness: int = 200, size: tuple[int, int] = (W, H)) -> dict[str, object]:
    """What the camera sees of a wall 0.5 m away."""
    rgba, depth = ImageRgba8U(*size), ImageDepth32F(*size)
    rgba.mutable_data[:] = brightness
    depth.mutable_data[:] = 0.5
    return {"left.rgb_image": rgba, "left.depth_image": depth}


def make_bench(detector: MiddleDetector, **options: object) -> SystemBench:
    dut = PartDetector(
        detector=detector,
        cameras=[CAMERA],
        object_label="mug",
        part_label="handle",
        fusion=FUSION,
        **options,
    )
    return SystemBench(dut, **wall())


@pytest.fixture
def detector() -> MiddleDetector:
    return MiddleDetector()


@pytest.fixture
def bench(detector: MiddleDetector) -> SystemBench:
    return make_bench(detector)


def test_before_the_first_event_nothing_is_known(bench: SystemBench) -> None:
    assert not bench.dut.HasAnyDirectFeedthrough()
    assert bench.read("status") == DetectorStatus.WAITING
    assert bench.read("part_cloud") is ABSENT
    assert bench.read("masks") is ABSENT


def test_it_searches_once_without_a_request(bench: SystemBench, detector: MiddleDetector) -> None:
    bench.advance_to(1.0)

    assert detector.calls == [(0.0, "mug", "handle")]
    assert bench.read("status") == DetectorStatus.FOUND


def test_outputs_are_the_masks_and_their_fused_points(bench: SystemBench) -> None:
    bench.advance_to(PERIOD / 2)
    frame = bench.dut._cameras.capture(bench.context)
    assert frame is not None

    masks = MiddleDetector().detect(frame, object_label="mug", part_label="handle")
    cloud = fuse_views(frame, masks.part_masks, FUSION)

    found = bench.read("part_cloud")
    np.testing.assert_array_equal(bench.read("masks").part_masks[0], masks.part_masks[0])
    np.testing.assert_array_equal(found.points, cloud.points)
    # The wall stands 0.5 m in front of a camera at the origin.
    np.testing.assert_allclose(found.points[:, 2], 0.5, atol=1e-6)


def test_each_increase_of_the_request_searches_again(
    bench: SystemBench, detector: MiddleDetector
) -> None:
    bench.fix(request=0.0)
    bench.advance_to(0.3)
    first = bench.read("masks")
    bench.fix(request=1.0)
    bench.advance_to(0.8)
    second = bench.read("masks")
    bench.fix(request=0.0)
    bench.advance_to(1.0)

    assert detector.searches == [0.0, 0.375]
    assert second is not first
    assert bench.read("masks") is second


def test_a_search_that_fails_keeps_what_was_found(bench: SystemBench) -> None:
    bench.fix(request=0.0)
    bench.advance_to(0.1)
    masks, cloud = bench.read("masks"), bench.read("part_cloud")
    bench.fix(**wall(brightness=0), request=1.0)

    bench.advance_to(0.3)

    assert bench.read("status") == DetectorStatus.NOT_FOUND
    assert bench.read("masks") is masks
    assert bench.read("part_cloud") is cloud


def test_a_first_search_that_fails_is_repeated_on_request_only(
    bench: SystemBench, detector: MiddleDetector
) -> None:
    bench.fix(**wall(brightness=0), request=0.0)
    bench.advance_to(0.5)
    assert bench.read("status") == DetectorStatus.NOT_FOUND
    assert bench.read("masks") is ABSENT
    bench.fix(**wall(), request=1.0)

    bench.advance_to(1.0)

    assert detector.searches == [0.0, 0.5]
    assert bench.read("status") == DetectorStatus.FOUND


def test_it_waits_for_the_cameras(bench: SystemBench, detector: MiddleDetector) -> None:
    bench.fix(**wall(size=(0, 0)))
    bench.advance_to(0.2)
    assert bench.read("status") == DetectorStatus.WAITING
    bench.fix(**wall())

    bench.advance_to(1.0)

    assert detector.searches == [0.25]


def test_a_nan_request_starts_no_search(bench: SystemBench, detector: MiddleDetector) -> None:
    bench.fix(request=np.nan)

    bench.advance_to(1.0)

    assert detector.searches == [0.0]


def test_other_errors_are_not_swallowed(bench: SystemBench, detector: MiddleDetector) -> None:
    detector.detect = lambda frame, **labels: 1 / 0

    with pytest.raises(ZeroDivisionError):
        bench.advance_to(0.1)


def test_it_waits_for_images_with_labels_where_labels_are_connected(
    detector: MiddleDetector,
) -> None:
    bench = make_bench(detector, label_ids={"mug": (1,)})
    bench.fix("left.label_image", ImageLabel16I())
    bench.advance_to(0.3)
    assert bench.read("status") == DetectorStatus.WAITING
    assert detector.calls == []

    bench.fix("left.label_image", ImageLabel16I(W, H))
    bench.advance_to(0.6)

    assert bench.read("status") == DetectorStatus.FOUND


def test_the_frame_and_the_times_of_a_late_search_are_outputs(
    detector: MiddleDetector,
) -> None:
    detector.go.clear()
    bench = make_bench(detector, timing=Worker(period=PERIOD, poll_period=PERIOD))
    assert bench.read("frame") is ABSENT

    bench.advance_to(2.5 * PERIOD)  # Would never return if it waited for the detector.
    assert bench.read("status") == DetectorStatus.WAITING
    assert bench.read("times").tolist() == [0.0, -np.inf, -np.inf]
    assert bench.read("frame").stamp == 0.0

    detector.go.set()
    bench.dut.close()  # Finishes the search in progress.
    bench.advance_to(3.5 * PERIOD)
    assert bench.read("status") == DetectorStatus.FOUND
    assert bench.read("times").tolist() == [0.0, 3 * PERIOD, 0.0]
    assert detector.searches == [0.0]


@pytest.fixture
def robot() -> PandaModel:
    """A robot whose palm is where the camera sees the middle of the wall."""
    palm = PandaModel().link_poses(np.zeros(7))[GRIPPER_LINK] @ [0.0, 0.0, -0.08, 1.0]
    middle = 0.5 * np.linalg.solve(CAMERA.K, [W / 2, H / 2, 1.0])
    return PandaModel(X_WB=make_transform(np.eye(3), middle - palm[:3]))


def test_the_robot_is_removed_before_the_search(
    detector: MiddleDetector, robot: PandaModel
) -> None:
    bench = make_bench(detector, robot=robot)
    bench.fix(position_measured=np.zeros(7), width_measured=0.08)

    bench.advance_to(PERIOD / 2)

    assert detector.depth[H // 2, W // 2] == 0.0
    # The wall beside the robot, which is also what the masks select, stays.
    assert detector.depth[2, 2] == 0.5
    assert len(bench.read("part_cloud")) == 16 * 20


def test_a_search_waits_until_the_robots_position_is_known(
    detector: MiddleDetector, robot: PandaModel
) -> None:
    bench = make_bench(detector, robot=robot)
    bench.fix(position_measured=np.full(7, np.nan), width_measured=np.nan)
    bench.advance_to(1.5 * PERIOD)
    assert detector.searches == []

    bench.fix(position_measured=np.zeros(7))
    bench.advance_to(2.5 * PERIOD)

    assert detector.searches == [2 * PERIOD]
