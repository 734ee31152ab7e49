"""The cases of the benchmark: a sequence and the faults in it."""

from collections.abc import Callable
from dataclasses import dataclass

from poil_drake.benchmarks.tracking.sequence import HANG, SLIP, STILL
from poil_drake.perception.faults.delivery import (
    DelayedFrames,
    DroppedFrames,
    FrozenFrames,
    SwappedFrames,
)
from poil_drake.perception.faults.extrinsics import ExtrinsicsError
from poil_drake.perception.faults.injector import Fault
from poil_drake.perception.faults.scene import DepthError, DepthHoles, LightChange, Occluder
from poil_drake.perception.faults.surface import (
    GlossyObject,
    TransparentObject,
    UntexturedObject,
)


@dataclass(frozen=True, kw_only=True)
class TrackingCase:
    """A sequence and its faults.

    Attributes:
        sequence: HANG, SLIP or STILL.
        faults: Returns the faults, given the time at which those that end begin [s] and the names
            of the cameras.
        duration: How long the disturbance lasts [s], whose recovery is measured; 0 is an instant.
            None: there is none, or it lasts from beginning to end.
    """

    sequence: str = HANG
    faults: Callable[[float, tuple[str, ...]], tuple[Fault, ...]] = lambda start, names: ()
    duration: float | None = None


CASES = {
    "none": TrackingCase(),
    "still": TrackingCase(sequence=STILL),
    "slip": TrackingCase(sequence=SLIP, duration=0.0),
    "occluded": TrackingCase(
        faults=lambda start, names: (Occluder(start=start, duration=1.0, distance=0.25),),
        duration=1.0,
    ),
    "hand": TrackingCase(
        faults=lambda start, names: (
            Occluder(camera=names[0], start=start, duration=1.0, shape="hand", distance=0.25),
        ),
        duration=1.0,
    ),
    "dropped": TrackingCase(
        faults=lambda start, names: (DroppedFrames(start=start, duration=0.5),), duration=0.5
    ),
    "frozen": TrackingCase(
        faults=lambda start, names: (FrozenFrames(start=start, duration=0.5),), duration=0.5
    ),
    "delayed": TrackingCase(
        faults=lambda start, names: (
            DelayedFrames(camera=names[0], start=start, duration=1.0, delay=0.125),
        ),
        duration=1.0,
    ),
    "swapped": TrackingCase(
        faults=lambda start, names: (
            SwappedFrames(cameras=(names[0], names[-1]), start=start, duration=0.5),
        ),
        duration=0.5,
    ),
    "depth_holes": TrackingCase(faults=lambda start, names: (DepthHoles(share=0.3),)),
    "depth_bias": TrackingCase(faults=lambda start, names: (DepthError(bias=0.01),)),
    "depth_scale": TrackingCase(faults=lambda start, names: (DepthError(scale=1.02),)),
    "extrinsics": TrackingCase(
        faults=lambda start, names: (
            ExtrinsicsError(camera=names[0], translation=(0.01, 0.0, 0.0), rpy=(0.0, 1.0, 0.0)),
        )
    ),
    "dark": TrackingCase(faults=lambda start, names: (LightChange(start=start),)),
    "untextured": TrackingCase(faults=lambda start, names: (UntexturedObject(),)),
    "glossy": TrackingCase(faults=lambda start, names: (GlossyObject(),)),
    "transparent": TrackingCase(faults=lambda start, names: (TransparentObject(),)),
}
"""Case by name; `poil bench tracking --faults` selects."""
