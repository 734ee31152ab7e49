"""Checks that a recording holds what a demonstration needs."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from poil_drake.errors import DemonstrationError
from poil_drake.recording.demonstration.contents import CameraContents, Contents
from poil_drake.recording.demonstration.frame_tree import FrameTree
from poil_drake.recording.demonstration.layout import (
    CAMERAS_KEY,
    STATIC_TRANSFORM_TOPIC,
    TRANSFORM_TOPIC,
    WORLD_FRAME,
    WORLD_FRAME_KEY,
    camera_topic,
)
from poil_drake.recording.demonstration.stamp_checks import color_and_depth
from poil_drake.recording.mcap.timestamps import to_seconds

MIN_FRAMES = 2
"""A motion has at least a start and an end."""

MAX_MISSING_END = 0.5
"""The end of the demonstration shows the goal, so nothing may stop much before the rest [s]."""

_LONGEST_END = 1.0  # [s] from the last frame in which no image is missing to the end

# In the name of the frame of depth that the driver of a RealSense has registered to colour.
_REALSENSE_REGISTERED = "aligned_depth_to_color"


def camera_names(path: Path, contents: Contents) -> list[str]:
    """Returns the camera names: those in the metadata, in that order, then any others, sorted."""
    text = contents.metadata.get(CAMERAS_KEY, "[]")
    try:
        listed = json.loads(text)
    except json.JSONDecodeError:
        listed = None
    if not isinstance(listed, list):
        raise DemonstrationError(
            f"{path}: the metadata '{CAMERAS_KEY}' is not a JSON list: {text[:80]}",
            remedy='Use a list of camera names, e.g. ["left", "right"].',
        )
    names = list(dict.fromkeys([*map(str, listed), *sorted(contents.cameras)]))
    if not names:
        raise DemonstrationError(
            f"{path} has no camera: no topic is named {camera_topic('<name>', 'image')}.",
            remedy="Record colour, depth and calibration of each camera, as described in "
            "docs/demonstration_format.md. If this is a ROS bag, use `poil demo import` first.",
        )
    return names


def check_camera(path: Path, contents: Contents, name: str) -> None:
    """Raises a DemonstrationError unless a camera has calibration, colour and registered depth."""
    camera, kinds = contents.cameras.get(name, CameraContents()), ("image", "depth", "calibration")
    present = " and ".join(kind for kind in kinds if getattr(camera, kind)) or "no other topic"
    for kind in kinds:
        messages, topic = getattr(camera, kind), camera_topic(name, kind)
        if not messages:
            raise DemonstrationError(
                f"{path}: camera '{name}' has no topic {topic}; it has {present}. Cameras in the "
                f"file: {', '.join(repr(c) for c in sorted(contents.cameras)) or 'none'}.",
                remedy="Record colour, depth and calibration of each camera, or select a camera "
                "that has all three.",
            )
        if kind != "calibration" and len(messages) < MIN_FRAMES:
            raise DemonstrationError(
                f"{path}: topic {topic} has only {len(messages)} message, but at least "
                f"{MIN_FRAMES} are needed.",
                remedy="Record the whole motion.",
            )
    color_frame, depth_frame = camera.image[0].frame_id, camera.depth[0].frame_id
    if camera.depth_calibration:
        color_frame, depth_frame = camera.frame_id, camera.depth_frame_id
        if not contents.frames.connected(base=color_frame, frame=depth_frame):
            raise DemonstrationError(
                f"{path}: no transform connects the depth images' frame '{depth_frame}' with the "
                f"colour images' frame '{color_frame}' of camera '{name}'.",
                remedy=f"Record this transform on {STATIC_TRANSFORM_TOPIC}.",
            )
    elif not _registered(contents.frames, color_frame, depth_frame):
        raise DemonstrationError(
            f"{path}: the depth images of camera '{name}' are in frame '{depth_frame}', but its "
            f"colour images are in frame '{color_frame}'.",
            remedy="Record depth registered to colour (e.g. aligned_depth_to_color), or also the "
            f"depth images' own calibration on {camera_topic(name, 'depth_calibration')}.",
        )


def _registered(frames: FrameTree, color_frame: str, depth_frame: str) -> bool:
    """Returns whether images in the two frames are in one view, as far as the names tell."""
    if not color_frame or not depth_frame or color_frame == depth_frame:
        return True
    if _REALSENSE_REGISTERED in depth_frame:
        return True
    if not frames.connected(base=color_frame, frame=depth_frame):
        return False
    X_CD = frames.pose(base=color_frame, frame=depth_frame, stamp=0)
    return np.allclose(X_CD, np.eye(4), rtol=0.0, atol=1e-6)


def check_end(path: Path, cameras: Mapping[str, CameraContents], rows: np.ndarray) -> None:
    """Checks that all topics and the last frame reach the end.

    Args:
        path: The file, for errors.
        cameras: The cameras.
        rows: (F, S) indices of each frame's images into the streams of `color_and_depth`.

    Raises:
        DemonstrationError: if a topic ends `MAX_MISSING_END` before the last one, or the last frame
            is `_LONGEST_END` before the end.
    """
    streams = color_and_depth(cameras)
    ends = {topic: to_seconds(stream[-1].stamp) for topic, stream in streams.items()}
    end = max(ends.values())
    for topic, last in ends.items():
        if end - last > MAX_MISSING_END:
            raise DemonstrationError(
                f"{path}: topic {topic} stops {end - last:.2f} s before the recording ends.",
                remedy="Record all cameras until the end, which shows the goal. If the cameras' "
                "clocks differ, correct the timestamps.",
            )
    if not len(rows):
        return
    last = max(s[i].stamp for s, i in zip(streams.values(), rows[-1], strict=True))
    if end - to_seconds(last) > _LONGEST_END:
        raise DemonstrationError(
            f"{path}: in the last {end - to_seconds(last):.2f} s, the topics {', '.join(ends)} "
            "have no images of the same time.",
            remedy="Record with fewer or smaller images, so that none are dropped. The end of the "
            "recording shows the goal.",
        )


def base_frame(path: Path, contents: Contents, names: Sequence[str]) -> str:
    """Returns the name of the world frame.

    This is the frame named in the metadata, or else "world" if the file has such a frame, or else
    the root of the transform tree that holds the first camera.

    Raises:
        DemonstrationError: if a camera has no pose in the world frame, or that of another camera.
    """
    frames = contents.frames
    optical = {name: contents.cameras[name].frame_id for name in names}
    base = contents.metadata.get(WORLD_FRAME_KEY, WORLD_FRAME)
    if base not in frames and WORLD_FRAME_KEY not in contents.metadata:
        root = frames.root(optical[names[0]])
        base = root if root != optical[names[0]] else base
    for name, frame in optical.items():
        if not frames.connected(base=base, frame=frame):
            raise DemonstrationError(
                f"{path}: no transform connects frame '{base}' with frame '{frame}' of camera "
                f"'{name}'. The transforms in the file: {frames.listing()}.",
                remedy=f"Record a foxglove.FrameTransform on {TRANSFORM_TOPIC} whose child frame "
                "is the calibration's frame_id. For a ROS bag, name its world with --world, record "
                f"{STATIC_TRANSFORM_TOPIC}, too, or take the poses from a scenario (--scenario).",
            )
        same = [other for other in names if optical[other] == frame]
        if len(same) > 1:
            raise DemonstrationError(
                f"{path}: the cameras {' and '.join(same)} have the same frame, '{frame}'.",
                remedy="Give each camera's driver another name and record again. For a ROS bag, "
                "the poses can also be those of a scenario (--scenario).",
            )
    return base
