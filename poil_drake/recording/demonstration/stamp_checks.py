"""Judges the stamps of recorded streams before they are used.

Header stamps may not be filled in, and cameras may be stamped by different clocks. Where the times
of logging show that stamps are wrong, the recording is refused.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from poil_drake.errors import DemonstrationError
from poil_drake.recording.demonstration.stored_images import StoredImage
from poil_drake.recording.mcap.timestamps import to_seconds

_LARGEST_GAP = 5.0  # [s] between two images of a topic; no camera pauses for so long
_LARGEST_SWAP = 0.1  # [s] by which a message may be late in the file
# [s] between the latencies of two streams, from capture to logging. Two cameras have about the
# same latency, but different clocks are off by anything.
_LARGEST_OFFSET = 0.3

Streams = Mapping[str, Sequence[StoredImage]]
"""The images of each topic, in the order of the file."""


def lack_stamps(streams: Streams) -> bool:
    """Returns whether all stamps of a topic are 0 because they are not filled in."""
    return any(len(images) > 1 and not any(i.stamp for i in images) for images in streams.values())


def stamped_by_log_time(images: Sequence[StoredImage]) -> list[StoredImage]:
    """Returns the images with the times at which they were logged as their stamps."""
    return [replace(image, stamp=image.log_time) for image in images]


def check_stamps(path: Path, streams: Streams) -> None:
    """Checks that the stamps of each topic advance, and that all are of one clock.

    Raises:
        DemonstrationError: if they do not. The message names the topics, the time and the gap.
    """
    for topic, images in streams.items():
        _check_topic(path, topic, images)
    _check_clocks(path, streams)


def in_order(images: Sequence[StoredImage]) -> list[StoredImage]:
    """Returns images sorted by stamp, and only the first of those with equal stamps."""
    found: dict[int, StoredImage] = {}
    for image in images:
        found.setdefault(image.stamp, image)
    return [found[stamp] for stamp in sorted(found)]


def _check_topic(path: Path, topic: str, images: Sequence[StoredImage]) -> None:
    stamps = np.array([image.stamp for image in images], dtype=np.int64)
    if 2 * len(np.unique(stamps)) < len(stamps):
        raise DemonstrationError(
            f"{path}: most messages of topic {topic} repeat the stamp of another: {len(stamps)} "
            f"messages have {len(np.unique(stamps))} different stamps, the first is "
            f"{to_seconds(int(stamps[0]))} s.",
            remedy="Fill in the time of capture of each image, with nanoseconds, or leave all "
            "stamps 0: then the times of logging are used.",
        )
    steps = np.diff(stamps) * 1e-9
    swap = max(_LARGEST_SWAP, 2.0 * float(np.median(np.abs(steps)))) if len(steps) else 0.0
    (wrong,) = np.nonzero((steps < -swap) | (steps > _LARGEST_GAP))
    if not wrong.size:
        return
    before, after = int(stamps[wrong[0]]), int(stamps[wrong[0] + 1])
    zeros = int(np.count_nonzero(stamps == 0))
    if 0 in (before, after):
        raise DemonstrationError(
            f"{path}: {zeros} of {len(stamps)} messages of topic {topic} have the stamp 0, but the "
            f"message {'after' if before == 0 else 'before'} it has {to_seconds(before or after)} "
            "s.",
            remedy="Fill in these stamps, or cut these messages off, e.g. with `mcap filter`. If "
            "all stamps of a topic are 0, the times of logging are used.",
        )
    gap = abs(after - before) * 1e-9
    raise DemonstrationError(
        f"{path}: the stamps of topic {topic} jump {'back' if after < before else 'ahead'} by "
        f"{gap:.3f} s after {to_seconds(before)} s.",
        remedy="Record again without setting the clock meanwhile, or cut the recording there, e.g. "
        "with `mcap filter`. If all stamps of a topic are 0, the times of logging are used.",
    )


def _check_clocks(path: Path, streams: Streams) -> None:
    """Compares the latencies of the streams at their starts and ends.

    The least latency within a second counts, because a busy recorder logs late, but never early.
    """
    found: list[tuple[float, str, float]] = []
    drifts = []
    for topic, images in streams.items():
        stamps, logged = (
            np.array([getattr(image, name) for image in images], dtype=np.int64)
            for name in ("stamp", "log_time")
        )
        latency = (logged - stamps) * 1e-9
        seconds = (stamps - stamps.min()) * 1e-9
        first, last = seconds <= 1.0, seconds >= seconds.max() - 1.0
        found += [
            (float(latency[part].min()), topic, to_seconds(int(stamps[part].min())))
            for part in (first, last)
        ]
        drifts.append(np.ptp(logged) * 1e-9 - seconds.max())
    # The recording may have been logged at another speed, e.g. when it was converted.
    if not drifts or abs(float(np.median(drifts))) > _LARGEST_OFFSET:
        return
    least, most = min(found), max(found)
    if most[0] - least[0] > _LARGEST_OFFSET:
        raise DemonstrationError(
            f"{path}: the clocks of the stamps differ or jump: the images of topic {least[1]} are "
            f"logged {least[0]:.2f} s after their stamps at {least[2]:.3f} s, but those of topic "
            f"{most[1]} {most[0]:.2f} s after theirs at {most[2]:.3f} s, a gap of "
            f"{most[0] - least[0]:.2f} s.",
            remedy="Synchronize the clocks (e.g. with chrony), correct the stamps, or set all "
            "stamps to 0: then the times of logging are used.",
        )
