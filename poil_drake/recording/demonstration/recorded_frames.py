"""The frames of a demonstration file, decoded when they are accessed."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from poil_drake.perception.images import CameraModel, MultiViewFrame, RgbdImage
from poil_drake.recording.demonstration.stored_images import StoredImages
from poil_drake.recording.mcap.message_decoders import Calibration
from poil_drake.recording.mcap.timestamps import to_seconds

# A 640 x 480 frame of two cameras takes 4 MB; a tracker needs a frame and its predecessor.
_CACHED_FRAMES = 4


@dataclass(frozen=True, eq=False)
class StoredView:
    """What one camera saw at one instant, not yet decoded.

    Attributes:
        name: The camera's name.
        calibration: Its intrinsics.
        X_WC: (4, 4) pose of the camera in the world [m].
        images: Its images.
    """

    name: str
    calibration: Calibration
    X_WC: np.ndarray
    images: StoredImages


class RecordedFrames(Sequence[MultiViewFrame]):
    """A sequence of frames, each decoded from the file when it is accessed.

    The last few frames are cached. Accessing a frame whose images cannot be decoded raises a
    DemonstrationError that names the file and the topic.

    Args:
        path: The file.
        instants: The views of each instant, in chronological order.
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
        self._frame = lru_cache(_CACHED_FRAMES)(self._decode)

    @property
    def stamps(self) -> np.ndarray:
        """The (T,) stamps of the frames [s]; reading them decodes no images."""
        return np.array(
            [min(to_seconds(view.images.color.stamp) for view in views) for views in self._instants]
        )

    @property
    def labelled(self) -> bool:
        """Whether any view has a label image; reading this decodes no images."""
        return any(view.images.label is not None for views in self._instants for view in views)

    def __len__(self) -> int:
        return len(self._instants)

    def __getitem__(self, index: int | slice) -> Any:
        """Returns one frame, or a slice as `RecordedFrames`."""
        if isinstance(index, slice):
            return RecordedFrames(self._path, self._instants[index], self._label_ids)
        return self._frame(range(len(self))[index])

    def _decode(self, index: int) -> MultiViewFrame:
        views = self._instants[index]
        # Images first, because decoding them checks the size in the calibration.
        images = tuple(self._image(view) for view in views)
        cameras = tuple(
            CameraModel(v.name, v.calibration.width, v.calibration.height, v.calibration.K, v.X_WC)
            for v in views
        )
        labelled = any(view.images.label is not None for view in views)
        return MultiViewFrame(cameras, images, self._label_ids if labelled else {})

    def _image(self, view: StoredView) -> RgbdImage:
        lens = view.calibration
        return view.images.read(
            self._path,
            view.name,
            size=(lens.width, lens.height),
            size_source="the camera is calibrated for",
            lens=lens,
        )
