"""How OpenCV opens what it can read: devices, URLs, pipelines, files and numbered images."""

import re
from pathlib import Path

import cv2

from poil_drake.errors import CaptureError

_OPEN_TIMEOUT, _READ_TIMEOUT = 5000, 1000
"""For a URL [ms]; OpenCV's own are 30 s."""

_NUMBERED = re.compile(r"%0?\d*d")
"""In a pattern of numbered images."""


def is_file(source: str) -> bool:
    """Returns whether a source can be read as fast as one likes."""
    if _is_stream(source) or source.isdecimal():
        return False
    return not Path(source).is_char_device()


def open_source(source: str, *, camera: str) -> cv2.VideoCapture:
    """Opens a source.

    Args:
        source: See `OpenCvStreams`.
        camera: What to call the camera in an error.

    Raises:
        CaptureError: if OpenCV cannot open it.
    """
    capture = _open(source)
    if not capture.isOpened():
        raise CaptureError(
            f"{camera}: OpenCV cannot open '{source}'.",
            remedy="Check the name, the permissions (group video), and that no other program "
            "uses it; a pipeline needs an OpenCV that was built with GStreamer.",
        )
    return capture


def configure_live(
    capture: cv2.VideoCapture,
    *,
    source: str,
    camera: str,
    size: tuple[int, int],
    fps: float,
    fourcc: str,
) -> None:
    """Asks a device for a format, and sees what a live source delivers.

    A URL or a pipeline delivers what its sender does; it is not asked.

    Args:
        capture: The source, open.
        source: See `OpenCvStreams`.
        camera: What to call the camera in an error.
        size: (height, width) of the images [px].
        fps: Images per second; a device that has another rate is taken as it is.
        fourcc: The format; empty: the device's own choice.

    Raises:
        CaptureError: if it says that it delivers another size or format.
    """
    height, width = size
    found_format = fourcc
    if not _is_stream(source):
        if fourcc:
            capture.set(cv2.CAP_PROP_FOURCC, cv2.VideoWriter.fourcc(*fourcc))
        capture.set(cv2.CAP_PROP_FRAME_WIDTH, width)
        capture.set(cv2.CAP_PROP_FRAME_HEIGHT, height)
        capture.set(cv2.CAP_PROP_FPS, fps)
        if fourcc:
            code = int(capture.get(cv2.CAP_PROP_FOURCC)) & 0xFFFFFFFF
            found_format = code.to_bytes(4, "little").decode("ascii", "replace")
    found = (
        int(capture.get(cv2.CAP_PROP_FRAME_WIDTH)),
        int(capture.get(cv2.CAP_PROP_FRAME_HEIGHT)),
    )
    # One that does not say its size shows it by its images.
    if (found != (width, height) and min(found) > 0) or found_format != fourcc:
        raise CaptureError(
            f"{camera}: '{source}' delivers {found[0]} x {found[1]} pixels"
            f"{f' as {found_format!r}' if fourcc else ''}, not {width} x {height}"
            f"{f' as {fourcc!r}' if fourcc else ''}.",
            remedy="Choose a size and a format that it has (v4l2-ctl --list-formats-ext lists "
            "them), with the calibration for that size.",
        )


def _is_stream(source: str) -> bool:
    return " ! " in source or "://" in source


def _open(source: str) -> cv2.VideoCapture:
    if source.isdecimal():
        return cv2.VideoCapture(int(source))
    if " ! " in source:
        return cv2.VideoCapture(source, cv2.CAP_GSTREAMER)
    if "://" in source:
        timeouts = [
            *(cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, _OPEN_TIMEOUT),
            *(cv2.CAP_PROP_READ_TIMEOUT_MSEC, _READ_TIMEOUT),
        ]
        return cv2.VideoCapture(source, cv2.CAP_FFMPEG, timeouts)
    if _NUMBERED.search(source):
        # FFmpeg, which OpenCV would ask first, makes 8 bit of 16.
        return cv2.VideoCapture(source, cv2.CAP_IMAGES)
    return cv2.VideoCapture(source)
