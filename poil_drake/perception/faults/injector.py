"""Injects faults into a stream of frames."""

from collections import deque
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from poil_drake.errors import InvalidValueError
from poil_drake.perception.faults.delivery import (
    DelayedFrames,
    DroppedFrames,
    FrozenFrames,
    SwappedFrames,
)
from poil_drake.perception.faults.extrinsics import ExtrinsicsError, miscalibrated
from poil_drake.perception.faults.fault import CameraFault, Capture
from poil_drake.perception.faults.scene import DepthError, DepthHoles, LightChange, Occluder
from poil_drake.perception.faults.surface import (
    GlossyObject,
    ObjectFault,
    TransparentObject,
    UntexturedObject,
)
from poil_drake.perception.images import MultiViewFrame, RgbdImage

SeenFault = (
    Occluder
    | DepthHoles
    | DepthError
    | LightChange
    | UntexturedObject
    | GlossyObject
    | TransparentObject
)
"""A fault of what one image shows; its `apply` returns the changed image."""

Fault = DroppedFrames | FrozenFrames | DelayedFrames | SwappedFrames | ExtrinsicsError | SeenFault
"""Any fault, chosen in YAML by a tag, e.g. `!DroppedFrames {camera: left, start: 6}`."""

_ROUNDING = 1e-6  # [s]


class FaultInjector:
    """Applies faults to the frames of one stream, in the order of their capture.

    Each image first gets the faults of what it shows, in their order in the list. Then come the
    faults of its delivery: cameras swapped, then delayed, then frozen or dropped. Equal streams and
    seeds give equal results.
    """

    def __init__(self, faults: Sequence[Fault], *, object_label: str = "", seed: int = 0):
        """Constructs the injector of a new stream.

        Args:
            faults: The faults.
            object_label: The object's name in `MultiViewFrame.label_ids`, for faults of its
                surface.
            seed: Seed of random faults.
        """
        self._faults, self._object_label, self._seed = tuple(faults), object_label, seed
        delays = [fault.delay for fault in faults if isinstance(fault, DelayedFrames)]
        self._memory = max(delays, default=0.0)
        self._recent: dict[str, deque[RgbdImage]] = {}
        self._delivered: dict[str, RgbdImage] = {}

    def needs_labels(self, time: float) -> bool:
        """Returns whether a fault at a time of capture [s] needs to know the object's pixels."""
        return any(isinstance(f, ObjectFault) and f.is_active(time) for f in self._faults)

    def apply(self, frame: MultiViewFrame) -> MultiViewFrame:
        """Returns the frame with the faults at its time.

        Raises:
            InvalidValueError: if a fault names an unknown camera, or concerns the object's surface
                and the frame has no labels of the object.
        """
        check_cameras(self._faults, [camera.name for camera in frame.cameras])
        images = {c.name: self._seen(frame, view) for view, c in enumerate(frame.cameras)}
        now = {name: image.stamp for name, image in images.items()}
        for fault in self._faults:
            if isinstance(fault, SwappedFrames) and fault.is_active(frame.stamp):
                a, b = fault.cameras
                images[a], images[b] = images[b], images[a]
        return MultiViewFrame(
            cameras=miscalibrated(frame.cameras, self._faults),
            images=tuple(self._deliver(name, image, now[name]) for name, image in images.items()),
            label_ids=frame.label_ids,
        )

    def _seen(self, frame: MultiViewFrame, view: int) -> RgbdImage:
        """Returns the image of a view with the faults of what it shows."""
        camera, image, mask = frame.cameras[view], frame.images[view], None
        if image.label is not None and self.needs_labels(image.stamp):
            mask = np.isin(image.label, frame.label_ids.get(self._object_label, ()))
        microseconds = max(0, round(image.stamp * 1e6))
        for number, fault in enumerate(self._faults):
            if isinstance(fault, SeenFault) and _acts(fault, camera.name, image.stamp):
                rng = np.random.default_rng((self._seed, number, view, microseconds))
                image = fault.apply(Capture(camera, image, mask, rng))
        return image

    def _deliver(self, name: str, image: RgbdImage, now: float) -> RgbdImage:
        """Returns the image that arrives instead of the captured one at the time `now` [s]."""
        recent = self._recent.setdefault(name, deque())
        recent.append(image)
        while len(recent) > 1 and recent[1].stamp <= now - self._memory + _ROUNDING:
            recent.popleft()
        last = self._delivered.get(name)
        for fault in self._faults:
            if isinstance(fault, DelayedFrames) and _acts(fault, name, now):
                old = [one for one in recent if one.stamp <= now - fault.delay + _ROUNDING]
                image = replace(old[-1] if old else recent[0], stamp=now)
        for fault in self._faults:
            if last is not None and isinstance(fault, FrozenFrames) and _acts(fault, name, now):
                image = replace(last, stamp=now)
        for fault in self._faults:
            if last is not None and isinstance(fault, DroppedFrames) and _acts(fault, name, now):
                image = last
        self._delivered[name] = image
        return image


def check_cameras(faults: Sequence[Fault], cameras: Sequence[str]) -> None:
    """Checks that the faults name existing cameras.

    Raises:
        InvalidValueError: if a fault names an unknown camera.
    """
    for fault in faults:
        named = fault.cameras if isinstance(fault, SwappedFrames) else (fault.camera,)
        for name in named:
            if name and name not in cameras:
                raise InvalidValueError(
                    f"The fault {type(fault).__name__} names the camera '{name}', which does not "
                    "exist.",
                    remedy=f"Choose one of: {', '.join(cameras)}.",
                )


def _acts(fault: CameraFault, camera: str, time: float) -> bool:
    return fault.affects(camera) and fault.is_active(time)
