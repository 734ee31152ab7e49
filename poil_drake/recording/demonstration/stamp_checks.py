"""Judges the stamps of recorded streams before they are used.

Header stamps may not be filled in, and cameras may be stamped by different clocks. Where the times
of logging show that stamps are wrong, the recording is refused.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from poil_drake.errors import DemonstrationError
from poil_drake.recording.demonstration.contents import CameraContents
from poil_drake.recording.demonstration.frame_tree import FrameTree
from poil_drake.recording.demonstration.layout import camera_topic
from poil_drake.recording.demonstration.stored_images import StoredImage
from poil_drake.recording.mcap.timestamps import to_seconds

_LARGEST_GAP = 5.0  # [s] between two images of a topic; no camera pauses for so long
_LARGEST_SWAP = 0.1  # [s] by which a message may be late in the file
# [s] between the latencies of two streams, from capture to logging. Two cameras have about the
# same latency, but different clocks are off by anything.
_LARGEST_OFFSET = 0.3
_LEAST_PERIOD = 1e-3  # [s] between two images of a topic; no camera is faster.


def settle_stamps(path: Path, frames: FrameTree, cameras: Mapping[str, CameraContents]) -> None:
    """Checks the stamps of the cameras' images, then sorts the images and drops repeated ones.

    If a topic has no stamps, the times of logging become the stamps of everything.

    Raises:
        DemonstrationError: if they do not advance, or are of different clocks. The message names
            the topics, the time and the gap.
    """
    streams = color_and_depth(cameras)
    unstamped = any(not any(image.stamp for image in images) for images in streams.values())
    if unstamped:
        frames.use_log_times()
    for camera in cameras.values():
        labels_unstamped = camera.image[0].stamp and not any(i.stamp for i in camera.label)
        for kind in ("image", "depth", "label"):
            if unstamped or (kind == "label" and labels_unstamped):
                images = getattr(camera, kind)
                setattr(camera, kind, [replace(image, stamp=image.log_time) for image in images])
    for topic, images in color_and_depth(cameras).items():
        _check_topic(path, topic, images)
    _check_clocks(path, cameras)
    for camera in cameras.values():
        for kind in ("image", "depth", "label"):
            setattr(camera, kind, _in_order(getattr(camera, kind)))


def color_and_depth(cameras: Mapping[str, CameraContents]) -> dict[str, list[StoredImage]]:
    """Returns the colour and depth images of the cameras, by topic."""
    return {
        camera_topic(name, kind): getattr(camera, kind)
        for name, camera in cameras.items()
        for kind in ("image", "depth")
    }


def _in_order(images: Sequence[StoredImage]) -> list[StoredImage]:
    """Returns images sorted by stamp, and only the first of those with equal stamps."""
    found: dict[int, StoredImage] = {}
    for image in images:
        found.setdefault(image.stamp, image)
    return [found[stamp] for stamp in sorted(found)]


def _check_topic(path: Path, topic: str, images: Sequence[StoredImage]) -> None:
    stamps = np.array([image.stamp for image in images], dtype=np.int64)
    different = len(np.unique(stamps))
    if different < 2 or 2 * different < len(stamps):
        raise DemonstrationError(
            f"{path}: most messages of topic {topic} repeat the stamp of another: {len(stamps)} "
            f"messages have {different} different stamps, the first is "
            f"{to_seconds(int(stamps[0]))} s.",
            remedy="Fill in the time of capture of each image, with nanoseconds, or leave all "
            "stamps 0: then the times of logging are used.",
        )
    period = float(np.median(np.diff(np.unique(stamps)))) * 1e-9
    if period < _LEAST_PERIOD:
        raise DemonstrationError(
            f"{path}: the stamps of topic {topic} are {period:.3g} s apart, the first is "
            f"{to_seconds(int(stamps[0]))} s. Probably their unit is wrong.",
            remedy="Write stamps in seconds and nanoseconds, or leave all stamps 0: then the times "
            "of logging are used.",
        )
    steps = np.diff(stamps) * 1e-9
    swap = float(np.clip(2.0 * np.median(np.abs(steps)), _LARGEST_SWAP, _LARGEST_GAP))
    (wrong,) = np.nonzero((steps < -swap) | (steps > _LARGEST_GAP))
    if not wrong.size:
        return
    before, after = int(stamps[wrong[0]]), int(stamps[wrong[0] + 1])
    zeros = int(np.count_nonzero(stamps == 0))
    direction = "back" if after < before else "ahead"
    raise _jump(path, topic, direction, abs(after - before) * 1e-9, before, zeros)


def _jump(
    path: Path, topic: str, direction: str, gap: float, before: int, zeros: int = 0
) -> DemonstrationError:
    return DemonstrationError(
        f"{path}: the stamps of topic {topic} jump {direction} by {gap:.3f} s after "
        f"{to_seconds(before)} s{f'; {zeros} of them are 0' if zeros else ''}.",
        remedy="Record again without setting the clock or stopping the camera meanwhile, fill in "
        "stamps that are 0, or cut the recording there, e.g. with `mcap filter`. If all stamps of "
        "a topic are 0, the times of logging are used.",
    )


def _check_clocks(path: Path, cameras: Mapping[str, CameraContents]) -> None:
    """Compares the latencies of the streams at their starts and ends.

    The least latency within a second counts, because a busy recorder logs late, but never early.
    If all latencies change alike, the recorder used another clock, e.g. that of a simulation;
    but if they drop at once, the clock of the stamps jumped ahead.
    Depth may take longer to compute: it is not compared if it has the stamps of the colour images.
    """
    streams = color_and_depth(cameras)
    for name, camera in cameras.items():
        ends_of_depth = {camera.depth[0].stamp, camera.depth[-1].stamp}
        if ends_of_depth <= {image.stamp for image in camera.image}:
            del streams[camera_topic(name, "depth")]
    starts: list[tuple[float, str, float]] = []
    ends: list[tuple[float, str, float]] = []
    drops: list[tuple[float, str, int]] = []
    for topic, images in streams.items():
        stamps, logged = (
            np.array([getattr(image, name) for image in images], dtype=np.int64)
            for name in ("stamp", "log_time")
        )
        latency, since = (logged - stamps) * 1e-9, (stamps - stamps.min()) * 1e-9
        for found, part in ((starts, since <= 1.0), (ends, since >= since.max() - 1.0)):
            found.append((float(latency[part].min()), topic, to_seconds(int(stamps[part].min()))))
        at = int(np.argmin(np.diff(latency)))
        drops.append((float(np.diff(latency)[at]), topic, int(stamps[at])))
    drift = float(np.median([end[0] - start[0] for start, end in zip(starts, ends, strict=True)]))
    if abs(drift) > _LARGEST_OFFSET:
        drop, topic, before = min(drops)
        if 0.8 * drift > drop > 1.2 * drift:
            raise _jump(path, topic, "ahead", -drop, before)
        return  # It was not logged in real time, e.g. when it was converted.
    least, *_, most = sorted([*starts, *((end[0] - drift, *end[1:]) for end in ends)])
    if most[0] - least[0] > _LARGEST_OFFSET:
        raise DemonstrationError(
            f"{path}: seen from the times of logging, the stamps of topic {least[1]} at "
            f"{least[2]:.3f} s and those of topic {most[1]} at {most[2]:.3f} s are of clocks that "
            f"differ, or of one that jumps: a gap of {most[0] - least[0]:.2f} s.",
            remedy="Synchronize the clocks (e.g. with chrony), correct the stamps, or set all "
            "stamps to 0: then the times of logging are used.",
        )
