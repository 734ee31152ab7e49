"""The frames of a demonstration file, decoded when they are asked for."""

from collections import OrderedDict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, overload

import numpy as np
from google.protobuf.message import DecodeError

from poil_drake.errors import DemonstrationError, InvalidValueError
from poil_drake.perception.images import CameraModel, MultiViewFrame, RgbdImage
from poil_drake.recording.demonstration.contents import StoredImage
from poil_drake.recording.demonstration.layout import camera_topic
from poil_drake.recording.demonstration.rectification import rectify
from poil_drake.recording.mcap.camera_messages import Calibration
from poil_drake.recording.mcap.image_messages import decode_color, decode_depth, decode_label
from poil_drake.recording.mcap.scan import read_messages
from poil_drake.recording.mcap.timestamps import to_seconds

# A 640 x 480 frame of two cameras takes 4 MB; a tracker looks at a frame and its predecessor.
_CACHED_FRAMES = 4


@dataclass(frozen=True, eq=False)
class StoredView:
    """What one camera saw at one instant, still in the file.

    Attributes:
        name: The camera's name.
        calibration: Its intrinsics.
        X_WC: (4, 4) its pose in the world [m].
        color: Its colour image.
        depth: Its depth image.
        label: Its label image, or None.
    """

    name: str
    calibration: Calibration
    X_WC: np.ndarray
    color: StoredImage
    depth: StoredImage
    label: StoredImage | None


class RecordedFrames(Sequence[MultiViewFrame]):
    """A sequence of frames, each decoded from the file when it is asked for.

    The few frames asked for last are kept. Asking for a frame whose images cannot be decoded
    raises a DemonstrationError that names the file and the topic.

    Args:
        path: The file.
        instants: The views of each instant, in order of time.
        label_ids: See `MultiViewFrame.label_ids`.
    """

    def __init__(
        self,
        path: Path,
        instants: Sequence[tuple[StoredView, ...]],
        label_ids: Mapping[str, tuple[int, ...]],
    ):
        self._path = path
        self._instants = tuple(instants)
        self._label_ids = dict(label_ids)
        self._cache: OrderedDict[int, MultiViewFrame] = OrderedDict()

    @property
    def stamps(self) -> np.ndarray:
        """The (T,) stamps of the frames [s], known without decoding them."""
        return np.array(
            [min(to_seconds(view.color.stamp) for view in views) for views in self._instants]
        )

    @property
    def labelled(self) -> bool:
        """Whether any view has a label image, known without decoding them."""
        return any(view.label is not None for views in self._instants for view in views)

    def __len__(self) -> int:
        return len(self._instants)

    @overload
    def __getitem__(self, index: int) -> MultiViewFrame: ...

    @overload
    def __getitem__(self, index: slice) -> Sequence[MultiViewFrame]: ...

    def __getitem__(self, index: int | slice) -> MultiViewFrame | Sequence[MultiViewFrame]:
        if isinstance(index, slice):
            return RecordedFrames(self._path, self._instants[index], self._label_ids)
        at = range(len(self))[index]
        frame = self._cache.pop(at, None) or self._decode(self._instants[at])
        self._cache[at] = frame
        if len(self._cache) > _CACHED_FRAMES:
            self._cache.popitem(last=False)
        return frame

    def _decode(self, views: tuple[StoredView, ...]) -> MultiViewFrame:
        wanted = [
            image
            for view in views
            for image in (view.color, view.depth, view.label)
            if image is not None
        ]
        data = read_messages(self._path, [image.location for image in wanted])
        bytes_of = {image.location: given for image, given in zip(wanted, data, strict=True)}
        cameras, images = [], []
        labelled = False
        for view in views:
            # The images first: they show whether the size in the calibration is right.
            images.append(self._decode_view(view, bytes_of))
            lens = view.calibration
            cameras.append(CameraModel(view.name, lens.width, lens.height, lens.K, view.X_WC))
            labelled = labelled or view.label is not None
        return MultiViewFrame(tuple(cameras), tuple(images), self._label_ids if labelled else {})

    def _decode_view(self, view: StoredView, bytes_of: Mapping[Any, bytes]) -> RgbdImage:
        pixels: dict[str, np.ndarray] = {}
        for kind, stored, decode in (
            ("image", view.color, decode_color),
            ("depth", view.depth, decode_depth),
            ("label", view.label, decode_label),
        ):
            if stored is None:
                continue
            try:
                image = decode(stored.message_type.FromString(bytes_of[stored.location]))
                self._check_size(view, image)
            except (DecodeError, InvalidValueError) as error:
                problem = getattr(error, "problem", f"a message is damaged: {error}.")
                raise DemonstrationError(
                    f"{self._path}, topic {camera_topic(view.name, kind)}, at "
                    f"{to_seconds(stored.stamp)} s: {problem}",
                    remedy=getattr(error, "remedy", "Record the demonstration again."),
                ) from error
            pixels[kind] = rectify(image, view.calibration, interpolate=kind == "image")
        return RgbdImage(
            rgb=pixels["image"],
            depth=pixels["depth"],
            stamp=to_seconds(view.color.stamp),
            label=pixels.get("label"),
        )

    @staticmethod
    def _check_size(view: StoredView, image: np.ndarray) -> None:
        height, width = image.shape[:2]
        if (width, height) != (view.calibration.width, view.calibration.height):
            raise InvalidValueError(
                f"an image has {width} x {height} pixels, but the camera is calibrated for "
                f"{view.calibration.width} x {view.calibration.height}.",
                remedy="Record colour and depth registered to each other, at the size of the "
                "calibration.",
            )
