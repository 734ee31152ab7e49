"""Faults of the way from a camera to its consumers: the right images at the wrong time or place."""

from dataclasses import dataclass

from poil_drake.perception.faults.fault import CameraFault, TimedFault


@dataclass(frozen=True, kw_only=True)
class DroppedFrames(CameraFault):
    """No new image arrives: the last one stays, with its stamp."""


@dataclass(frozen=True, kw_only=True)
class FrozenFrames(CameraFault):
    """The last image arrives over and over, stamped as if it were new."""


@dataclass(frozen=True, kw_only=True)
class DelayedFrames(CameraFault):
    """Old images arrive, stamped as if they were new, as if the camera's clock were wrong.

    Attributes:
        delay: The true age of the images [s].
    """

    delay: float

    def __post_init__(self) -> None:
        super().__post_init__()
        self._require("delay", self.delay >= 0.0, "a time of at least 0 s")


@dataclass(frozen=True, kw_only=True)
class SwappedFrames(TimedFault):
    """Two cameras deliver each other's images, as if their names were exchanged.

    Attributes:
        cameras: The two cameras' names.
    """

    cameras: tuple[str, str]
