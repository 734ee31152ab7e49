"""Where the images of a camera come from, as configuration; no camera library is loaded for it.

The names of the classes are tags in YAML, e.g. `!RealSense {serial: "913522070157"}`. What must be
given, such as a file, is empty by default and asked for when the device is made.
"""

import math
from dataclasses import dataclass

from poil_drake.errors import InvalidValueError


@dataclass(frozen=True, kw_only=True)
class RealSense:
    """An Intel RealSense; it needs `pyrealsense2`.

    Stamps are the camera's own, which its library converts to this computer's clock ("global
    time"): when the read-out began of the older of the two images, half an exposure time after the
    middle of the exposure. Where the camera gives no global time, as on some kernels, it is the
    image's arrival less the latency (see `FramePairStamps`).

    Attributes:
        serial: Which camera, by the number printed on it; empty: the only one there is.
        fps: Images per second. 30 is what all models offer at 640 x 480.
        depth_width: Of the depth sensor's own image, before it is aligned to colour [px]; 0: that
            of the colour image. Aligning holds Python up for 1 ms at 640 x 480, and for 4 ms at
            1280 x 720, so the smaller is the better one beside a control loop.
        depth_height: Likewise.
        latency: From a capture to the arrival of its image [s], used only where the camera
            gives no global time. 30 ms is one period plus the transfer.
        silence: After so long without a new image the camera counts as gone, and is opened anew
            [s]. Opening holds Python up, for about a second: a control loop must have stopped the
            robot before that, by the age of the last image.
        settle: Images that come within this time after opening are dropped [s]: the exposure
            adjusts itself.
    """

    serial: str = ""
    fps: int = 30
    depth_width: int = 0
    depth_height: int = 0
    latency: float = 0.03
    silence: float = 2.0
    settle: float = 1.0

    def __post_init__(self) -> None:
        _check_positive(self, "fps", "silence")
        _check_not_negative(self, "depth_width", "depth_height", "latency", "settle")


@dataclass(frozen=True, kw_only=True)
class Zed:
    """A Stereolabs ZED; it needs the ZED SDK with its Python API, `pyzed`.

    Colour is the rectified left image, and depth is measured from it. An image of the camera is
    scaled down to the size that the scenario asks for; both must have the same proportions.

    Attributes:
        serial: Which camera, by the number printed on it; 0: the only one there is.
        resolution: A name of `sl.RESOLUTION`. HD720 has the smallest delay of those that are
            sharp enough; ZED X models have no HD720 but HD1200 and SVGA.
        depth_mode: A name of `sl.DEPTH_MODE`. NEURAL keeps the edges of thin objects, such as a
            handle, and must have been optimized for the GPU before, by ZED_Diagnostic, which takes
            minutes; PERFORMANCE asks less of the GPU.
        fps: Images per second.
        latency: From a capture to the SDK's stamp of its image [s]. The SDK stamps an image when it
            has arrived in memory, which its documentation says is 2 to 3 periods after the capture:
            67 ms are 2 periods at 30 per second.
        silence: After so long without a new image the camera is opened anew [s]. The SDK recovers
            a camera by itself, and closing and opening it hold Python up for seconds, so this comes
            last.
        settle: Images that come within this time after opening are dropped [s]: the exposure
            adjusts itself.
    """

    serial: int = 0
    resolution: str = "HD720"
    depth_mode: str = "NEURAL"
    fps: int = 30
    latency: float = 0.067
    silence: float = 10.0
    settle: float = 1.0

    def __post_init__(self) -> None:
        _check_positive(self, "fps", "silence")
        _check_not_negative(self, "serial", "latency", "settle")


@dataclass(frozen=True, kw_only=True)
class OpenCvStreams:
    """Any two sources that OpenCV's `VideoCapture` opens, registered to each other.

    Each is the number of a device ("0"), its path ("/dev/video0"), a URL, or a GStreamer pipeline
    (in an OpenCV that was built with it), which all are live, or both are files: a video or a
    pattern of numbered images ("depth_%04d.png"). Such sources carry no times: an image's stamp is
    when the older of colour and depth arrived, less the latency.

    Devices are asked for the scenario's image size, and for `fps`; what has another size is
    refused.

    Attributes:
        rgb: The source of colour images, 8 bit.
        depth: The source of depth images, of one channel with 16 bit, in the view of the colour
            camera; 0 is invalid.
        depth_scale: What one step of the depth is [m]; most cameras count millimetres.
        latency: From a capture to the arrival of its image [s]. Measure it, e.g. by filming a
            clock.
        fps: Images per second to read from files, which do not come by themselves, and to ask of
            devices, which may have another rate.
        rgb_fourcc: Which format a colour device is to deliver, e.g. MJPG; empty: its own choice.
        depth_fourcc: Likewise of a depth device, e.g. "Y16 ".
        largest_gap: Between the arrivals of a live colour and depth image that are taken as one
            [s]: of two sources at 30 Hz the nearest are 17 ms apart at most.
        silence: After so long without a new pair live sources count as gone, and are opened anew
            [s].
        settle: Live images that come within this time after opening are dropped [s]: the exposure
            adjusts itself.
    """

    rgb: str = ""
    depth: str = ""
    depth_scale: float = 0.001
    latency: float = 0.0
    fps: float = 30.0
    rgb_fourcc: str = ""
    depth_fourcc: str = ""
    largest_gap: float = 0.02
    silence: float = 2.0
    settle: float = 1.0

    def __post_init__(self) -> None:
        _check_positive(self, "depth_scale", "fps", "largest_gap", "silence")
        _check_not_negative(self, "latency", "settle")
        for name in ("rgb_fourcc", "depth_fourcc"):
            code = getattr(self, name)
            if code and not (len(code) == 4 and code.isascii()):
                raise InvalidValueError(
                    f"OpenCvStreams.{name} is '{code}'.",
                    remedy="It must have 4 letters, e.g. MJPG, YUYV or 'Y16 '.",
                )


@dataclass(frozen=True, kw_only=True)
class McapPlayback:
    """A demonstration or the log of a run, played back in real time.

    It begins `lead_in` after the device was first opened, so that cameras that play the same file
    and are opened together stay in step, however long the file takes to be read through. Stamps are
    moved to now: the clock's time at the beginning plus the time since the recording's.

    Attributes:
        file: The MCAP file.
        camera: The camera's name in the file; empty: the same name.
        loop: Whether it begins again at its end; otherwise no more images come.
        rate: Seconds of the recording per second.
        lead_in: From opening to the first image [s]: long enough to read the file through, which
            takes about a second per minute of recording. What is late is left out.
        labels: Whether the recording holds label images of the camera, not necessarily with every
            image. Their numbers must be those of the scenario's models, as in a recording that was
            made with the same scenario. Who waits for a labelled image waits for one that comes
            after the cameras are ready: a recording with few of them, e.g. a demonstration with
            one, must be played in a loop that is shorter than `poil.hardware.ready_timeout`.
    """

    file: str = ""
    camera: str = ""
    loop: bool = False
    rate: float = 1.0
    lead_in: float = 1.0
    labels: bool = True

    def __post_init__(self) -> None:
        _check_positive(self, "rate")
        _check_not_negative(self, "lead_in")


DeviceConfig = RealSense | Zed | OpenCvStreams | McapPlayback
"""What `make_device` takes."""


def _check_positive(config: object, *names: str) -> None:
    for name in names:
        value = getattr(config, name)
        if not (math.isfinite(value) and value > 0):
            raise InvalidValueError(
                f"{type(config).__name__}.{name} is {value}.",
                remedy="It must be positive and finite.",
            )


def _check_not_negative(config: object, *names: str) -> None:
    for name in names:
        value = getattr(config, name)
        if not (math.isfinite(value) and value >= 0):
            raise InvalidValueError(
                f"{type(config).__name__}.{name} is {value}.",
                remedy="It must be finite and not negative.",
            )
