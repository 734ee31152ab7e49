"""What of a frame goes into a run log: what is not there yet."""

from collections.abc import Callable

from poil_drake.perception.images import MultiViewFrame
from poil_drake.recording.run_log.writer import RunLogWriter


def log_frame(
    log: RunLogWriter,
    frame: MultiViewFrame,
    *,
    time: float,
    is_new: Callable[[str, object], bool],
    color: bool,
    depth: bool,
) -> None:
    """Writes a frame's images, calibrations and meanings of labels, as far as they are new.

    Args:
        log: Where to write.
        frame: What to write.
        time: Now [s].
        is_new: Returns whether something of a name is not what it was when last asked.
        color: Whether colour images are written.
        depth: Whether depth images are.
    """
    if frame.label_ids and is_new("label ids", frame.label_ids):
        log.write_label_ids(frame.label_ids)
    for camera, image in zip(frame.cameras, frame.images, strict=True):
        if is_new(f"calibration of {camera.name}", camera):
            log.write_calibration(camera, time=time)
        if is_new(f"image of {camera.name}", image.stamp):
            if color:
                log.write_image(camera.name, image.rgb, time=time, stamp=image.stamp)
            if depth:
                log.write_depth(camera.name, image.depth, time=time, stamp=image.stamp)
        if image.label is not None and is_new(f"label of {camera.name}", image.stamp):
            log.write_label(camera.name, image.label, time=time, stamp=image.stamp)
