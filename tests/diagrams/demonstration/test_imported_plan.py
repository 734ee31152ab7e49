"""A demonstration is transferred alike, whether it was recorded as ours or as a ROS bag."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from labelled_frames import exact_masks, labelled
from ros_bags import (
    RosRecording,
    camera_info,
    compressed_depth,
    compressed_image,
    raw_image,
    transforms,
)

from poil_drake.diagrams.loop.perception import MakeScenarioTracker
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.diagrams.station.station import CaptureFrame, MakeStation
from poil_drake.perception.images import CameraModel, MultiViewFrame, RgbdImage
from poil_drake.recording.demonstration.demonstration import load_demonstration
from poil_drake.recording.demonstration.writer import DemonstrationWriter
from poil_drake.recording.mcap.message_encoder import ColorEncoding
from poil_drake.recording.ros_bag.bag_import import import_ros_bag
from poil_drake.transfer.matching import Matching
from poil_drake.transfer.pipeline import transfer

START = 1_764_500_000  # [s since the epoch]
LENS = np.array([-0.06, 0.02, 0.001, -0.0008, 0.0])
"""A distortion that moves the corners of the image by 9 pixels."""


def through_lens(image: RgbdImage, model: CameraModel) -> RgbdImage:
    """Returns what a camera with the same K and a lens would have seen."""
    pixels = np.stack(np.meshgrid(np.arange(model.width), np.arange(model.height)), axis=-1)
    points = pixels.reshape(-1, 1, 2).astype(np.float32)
    seen = cv2.undistortPoints(points, model.K, LENS, P=model.K).reshape(pixels.shape)
    return remap(image, seen[..., 0], seen[..., 1])


def without_lens(image: RgbdImage, model: CameraModel) -> RgbdImage:
    """Returns the rectified image."""
    size = (model.width, model.height)
    maps = cv2.initUndistortRectifyMap(model.K, LENS, None, model.K, size, cv2.CV_32FC1)
    return remap(image, *maps)


def remap(image: RgbdImage, u: np.ndarray, v: np.ndarray) -> RgbdImage:
    return replace(
        image,
        rgb=cv2.remap(image.rgb, u, v, cv2.INTER_LINEAR),
        depth=cv2.remap(image.depth, u, v, cv2.INTER_NEAREST),
        label=None if image.label is None else cv2.remap(image.label, u, v, cv2.INTER_NEAREST),
    )


def transferred(path: Path, scene: MultiViewFrame, scenario: Scenario) -> Matching:
    """Returns the likeliest match of a demonstration with a scene, whose grasp is then planned."""
    demonstration = load_demonstration(path)
    demonstration.check_plausible(table_height=scenario.poil.table_height)
    return transfer(
        demonstration,
        scene,
        source_masks=exact_masks(demonstration.frames[0]),
        target_masks=exact_masks(scene),
        tracker=MakeScenarioTracker(scenario.poil),
    ).matchings[0]


@pytest.mark.slow
@pytest.mark.render
def test_a_bag_with_lenses_and_compressed_depth_is_transferred_alike(
    demonstration: Path, scenario: Scenario, tmp_path: Path
) -> None:
    # The camera "right" has a lens, and sends compressed images.
    recorded = labelled(load_demonstration(demonstration), scenario)
    bag = RosRecording(start=0)
    for model in recorded.cameras:
        frame = f"{model.name}_color_optical_frame"
        bag.add("/tf_static", 0, transforms(START * 10**9, ("panda_link0", frame, model.X_WC)))
    ours = tmp_path / "ours.mcap"
    color = ColorEncoding(format="raw")
    with DemonstrationWriter(ours, ["left", "right"], {}, color=color) as writer:
        for view in recorded.frames[::2]:
            left, right = (replace(image, stamp=START + image.stamp) for image in view.images)
            seen = through_lens(right, view.cameras[1])
            rectified = without_lens(seen, view.cameras[1])
            writer.write(replace(view, images=(left, rectified)))
            add_frame(bag, view.cameras[0], left, compressed=False)
            add_frame(bag, view.cameras[1], seen, compressed=True)

    imported = import_ros_bag(
        bag.write_db3(tmp_path / "bag"),
        tmp_path / "demo.mcap",
        cameras={"left": "/left", "right": "/right"},
        label_ids=recorded.frames[0].label_ids,
        world="panda_link0",
    )
    station = MakeStation(scenario, ignore_output_delay=True)
    scene = CaptureFrame(station, station.CreateDefaultContext(), labels=True)

    dut = transferred(tmp_path / "demo.mcap", scene, scenario)

    wanted = transferred(ours, scene, scenario)
    assert imported.frames == len(recorded.frames[::2])
    np.testing.assert_allclose(dut.target_points, wanted.target_points, atol=1e-3)
    np.testing.assert_allclose(
        dut.reference.positions, wanted.reference.positions, rtol=0.0, atol=1e-3
    )


def add_frame(bag: RosRecording, model: CameraModel, image: RgbdImage, *, compressed: bool) -> None:
    prefix, frame = f"/{model.name}", f"{model.name}_color_optical_frame"
    color, depth = f"{prefix}/color/image_raw", f"{prefix}/aligned_depth_to_color/image_raw"
    stamp, size = round(image.stamp * 1e9), (model.width, model.height)
    millimetres = np.rint(1000 * image.depth).astype("<u2")
    lens = LENS if compressed else np.zeros(5)
    info = camera_info(model.K, size, stamp, frame, d=lens.tolist())
    bag.add(f"{prefix}/color/camera_info", stamp, info)
    if compressed:
        png = cv2.imencode(".png", image.rgb[..., ::-1], [cv2.IMWRITE_PNG_COMPRESSION, 1])[1]
        packed = compressed_image("rgb8; png compressed bgr8", png.tobytes(), stamp, frame)
        bag.add(f"{color}/compressed", stamp, packed)
        bag.add(f"{depth}/compressedDepth", stamp, compressed_depth(millimetres, stamp, frame))
    else:
        bag.add(color, stamp, raw_image("rgb8", image.rgb, stamp, frame))
        bag.add(depth, stamp, raw_image("16UC1", millimetres, stamp, frame))
    if image.label is not None:
        label = image.label.astype("<u2")
        bag.add(f"{prefix}/label", stamp, raw_image("16UC1", label, stamp, frame))
