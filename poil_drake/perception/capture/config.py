"""Configures where a camera's images come from. Importing this loads no camera library.

The names of the classes are tags in YAML, e.g. `!RealSense {serial: "913522070157"}`. A required
value, such as a file, is empty by default; the constructor of the device rejects an empty one.
"""

from dataclasses import dataclass

from poil_drake.errors import InvalidValueError
from poil_drake.perception.positive_fields import check_positive


@dataclass(frozen=True, kw_only=True)
class RealSense:
    """An Intel RealSense; it needs `pyrealsense2`.

    A colour and a depth image share one stamp: the end of the older image's exposure, not the
    middle, so the stamp is late by half the exposure time. The library converts this time from the
    camera's clock to this computer's ("global time"). With some kernels the camera has no global
    time; the stamp is then the image's arrival less `latency` (see `FramePairStamps`).

    Attributes:
        serial: The serial number printed on the camera; may be empty if only one is connected.
        fps: Images per second. All models offer 30 at 640 x 480.
        depth_width: Width of the depth image before it is aligned to colour [px]; 0 for the colour
            image's width. Alignment holds Python's interpreter for 1 ms at 640 x 480 and for 4 ms
            at 1280 x 720, so prefer 640 x 480 beside a control loop.
        depth_height: Height of the depth image before it is aligned to colour [px]; 0 for the
            colour image's height.
        latency: Time from a capture to the arrival of its image [s], used only if the camera has no
            global time. 30 ms is about one period at 30 images per second.
        silence: Time without a new image after which the camera is reopened [s]. Opening holds
            the interpreter for about a second. Choose a time so long that a control loop has
            already stopped the robot because the last image is too old.
        settle: Time after opening in which images are dropped while the exposure adapts [s].
    """

    serial: str = ""
    fps: int = 30
    depth_width: int = 0
    depth_height: int = 0
    latency: float = 0.03
    silence: float = 2.0
    settle: float = 1.0

    def __post_init__(self) -> None:
        check_positive(self, "fps", "silence")
        check_positive(self, "depth_width", "depth_height", "latency", "settle", or_zero=True)


@dataclass(frozen=True, kw_only=True)
class Zed:
    """A Stereolabs ZED; it needs the ZED SDK with its Python API, `pyzed`.

    Colour is the rectified left image, and depth is in the view of the left camera. Images are
    scaled down to the size in the scenario, which must have the same aspect ratio.

    Attributes:
        serial: The serial number printed on the camera; may be 0 if only one is connected.
        resolution: Name of a member of `sl.RESOLUTION`. HD720 has the smallest delay of the
            resolutions that are sharp enough. ZED X models have HD1200 and SVGA instead.
        depth_mode: Name of a member of `sl.DEPTH_MODE`. NEURAL preserves the edges of thin
            objects, such as a handle, but ZED_Diagnostic must first have optimized it for the GPU,
            which takes minutes. PERFORMANCE needs less of the GPU.
        fps: Images per second.
        latency: Time from a capture to the SDK's stamp of its image [s]. The SDK stamps an image
            when it arrives in memory, 2 to 3 periods after the capture according to the SDK's
            documentation. 67 ms is 2 periods at 30 images per second.
        silence: Time without a new image after which the camera is reopened [s]. Reopening is a
            last resort: the SDK recovers a camera by itself, and closing and opening hold the
            interpreter for seconds.
        settle: Time after opening in which images are dropped while the exposure adapts [s].
    """

    serial: int = 0
    resolution: str = "HD720"
    depth_mode: str = "NEURAL"
    fps: int = 30
    latency: float = 0.067
    silence: float = 10.0
    settle: float = 1.0

    def __post_init__(self) -> None:
        check_positive(self, "fps", "silence")
        check_positive(self, "serial", "latency", "settle", or_zero=True)


@dataclass(frozen=True, kw_only=True)
class OpenCvStreams:
    """A source of colour and a source of depth that OpenCV's `VideoCapture` opens.

    Both sources are live, or both are files. A live source is the number of a device ("0"), its
    path ("/dev/video0"), a URL, or a GStreamer pipeline if OpenCV was built with GStreamer. A file
    is a video or a pattern of numbered images ("depth_%04d.png"). OpenCV reports no capture times,
    so the stamp is the earlier arrival time of a colour and a depth image, less `latency`.

    The scenario's image size and `fps` are requested from devices; any other size is rejected.

    Attributes:
        rgb: The source of colour images, 8 bit.
        depth: The source of depth images, one 16-bit channel, in the view of the colour camera;
            0 is invalid.
        depth_scale: One step of the depth [m]; most cameras count millimetres.
        latency: Time from capture to arrival [s]. Measure it, e.g. by filming a clock.
        fps: Images per second to read from files or to request from devices. A device may deliver
            another rate.
        rgb_fourcc: Format to request from a colour device, e.g. MJPG; empty for its default.
        depth_fourcc: Format to request from a depth device, e.g. "Y16 ".
        largest_gap: Longest time between the arrivals of a live colour and a live depth image that
            form a pair [s]. The nearest images of two sources at 30 Hz are at most 17 ms apart.
        silence: Time without a new pair after which live sources are reopened [s].
        settle: Time after opening in which live images are dropped while the exposure adapts [s].
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
        check_positive(self, "depth_scale", "fps", "largest_gap", "silence")
        check_positive(self, "latency", "settle", or_zero=True)
        for name in ("rgb_fourcc", "depth_fourcc"):
            code = getattr(self, name)
            if code and not (len(code) == 4 and code.isascii()):
                raise InvalidValueError(
                    f"OpenCvStreams.{name} is '{code}'.",
                    remedy="Set 4 ASCII characters, e.g. MJPG, YUYV or 'Y16 '.",
                )


@dataclass(frozen=True, kw_only=True)
class McapPlayback:
    """A demonstration or the log of a run, played back in real time.

    Playback begins `lead_in` after the device is first opened. Cameras that play the same file and
    are opened together therefore stay in step, however long the file takes to read. The stamp of an
    image is the time when it is due, by the device's clock.

    Attributes:
        file: The MCAP file.
        camera: The camera's name in the file; empty for its name in the scenario.
        loop: Whether to start again at the end of the recording; otherwise no more images come.
        rate: Seconds of the recording that are played per second.
        lead_in: Time from opening to the first image [s], in which the file is read. Reading takes
            about a second per minute of recording. Images that are due before the file is read are
            skipped.
        labels: Whether the recording must hold label images of the camera; not every image needs
            one. Labels are matched by the names of models and parts, which must be those of the
            scenario. A run waits for a labelled image that comes after the cameras are ready. If
            few images are labelled, as in a demonstration, set `loop` and use a recording that is
            shorter than `poil.hardware.ready_timeout`.
    """

    file: str = ""
    camera: str = ""
    loop: bool = False
    rate: float = 1.0
    lead_in: float = 1.0
    labels: bool = True

    def __post_init__(self) -> None:
        check_positive(self, "rate")
        check_positive(self, "lead_in", or_zero=True)
