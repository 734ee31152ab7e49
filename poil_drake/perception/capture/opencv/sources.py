"""Opens a source with OpenCV: a device, a URL, a pipeline, a file, or numbered images."""

import re
from pathlib import Path

import cv2

from poil_drake.errors import CaptureError

_TIMEOUTS = [cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, 5000, cv2.CAP_PROP_READ_TIMEOUT_MSEC, 1000]
"""Timeouts for opening a URL and for reading an image from it [ms]. OpenCV's defaults are 30 s."""

_NUMBERED = re.compile(r"%0?\d*d")
"""Matches the number in a pattern of numbered images."""


def is_file(source: str) -> bool:
    """Returns whether a source (see `OpenCvStreams`) is a file or numbered images, not live."""
    if _is_stream(source) or source.isdecimal():
        return False
    return not Path(source).is_char_device()


def open_source(
    source: str, *, camera: str, size: tuple[int, int], fps: float, fourcc: str
) -> cv2.VideoCapture:
    """Opens an image source with OpenCV.

    A device is asked for a size, a rate and a format. A URL or a pipeline delivers what its sender
    sends.

    Args:
        source: A source as described in `OpenCvStreams`.
        camera: The camera's name in errors.
        size: (height, width) of the images [px].
        fps: Images per second to request. The device may deliver another rate.
        fourcc: The format to request; empty for the device's default.

    Raises:
        CaptureError: if OpenCV cannot open the source, or if a live source reports another size or
            format than requested.
    """
    capture = _open(source)
    if not capture.isOpened():
        raise CaptureError(
            f"{camera}: OpenCV cannot open '{source}'.",
            remedy="Check the source's name and permissions (group video), and that no other "
            "program uses it. A pipeline needs an OpenCV that was built with GStreamer.",
        )
    if is_file(source):
        return capture
    height, width = size
    if not _is_stream(source):
        if fourcc:
            capture.set(cv2.CAP_PROP_FOURCC, cv2.VideoWriter.fourcc(*fourcc))
        capture.set(cv2.CAP_PROP_FRAME_WIDTH, width)
        capture.set(cv2.CAP_PROP_FRAME_HEIGHT, height)
        capture.set(cv2.CAP_PROP_FPS, fps)
    found_size = tuple(
        int(capture.get(key)) for key in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT)
    )
    found_fourcc = fourcc
    if fourcc and not _is_stream(source):
        code = int(capture.get(cv2.CAP_PROP_FOURCC)) & 0xFFFFFFFF
        found_fourcc = code.to_bytes(4, "little").decode("ascii", "replace")
    # A source that does not report its size is checked by its images.
    if (found_size != (width, height) and min(found_size) > 0) or found_fourcc != fourcc:
        capture.release()
        raise CaptureError(
            f"{camera}: '{source}' delivers {found_size[0]} x {found_size[1]} pixels"
            f"{f' as {found_fourcc!r}' if fourcc else ''}, not {width} x {height}"
            f"{f' as {fourcc!r}' if fourcc else ''}.",
            remedy="Choose a size and a format that the source supports (v4l2-ctl "
            "--list-formats-ext lists them), and the calibration for that size.",
        )
    return capture


def _is_stream(source: str) -> bool:
    return " ! " in source or "://" in source


def _open(source: str) -> cv2.VideoCapture:
    if source.isdecimal():
        return cv2.VideoCapture(int(source))
    if " ! " in source:
        return cv2.VideoCapture(source, cv2.CAP_GSTREAMER)
    if "://" in source:
        return cv2.VideoCapture(source, cv2.CAP_FFMPEG, _TIMEOUTS)
    if _NUMBERED.search(source):
        # FFmpeg, OpenCV's first choice, would convert 16-bit images to 8 bit.
        return cv2.VideoCapture(source, cv2.CAP_IMAGES)
    return cv2.VideoCapture(source)
