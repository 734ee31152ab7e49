"""The base of learned trackers: it keeps a clip of frames, and asks a model's process about it."""

from abc import abstractmethod
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from poil_drake.errors import TrackingError
from poil_drake.perception.images import MultiViewFrame
from poil_drake.perception.trackers.learned.clip_process import ClipProcess
from poil_drake.perception.trackers.learned.config import ModelEnvironment
from poil_drake.perception.trackers.learned.environment import check_environment
from poil_drake.perception.trackers.protocol import TrackerOutput
from poil_drake.perception.trackers.rigid_points.tracker import (
    Matches,
    RigidPointsState,
    RigidPointsTracker,
    Sighting,
)


class Clip(NamedTuple):
    """The frames to show to a model.

    Attributes:
        frames: The first frame, the latest frames in which the object was tracked, and the new
            frame, repeated until there are enough.
        newest: Index of the new frame.
        queries: The frames in which the object's motion is known and its points are queried:
            (index in the clip, sighting). In the first frame, queries carry no errors. In the
            oldest of the others, the object looks more like it does now.
    """

    frames: tuple[MultiViewFrame, ...]
    newest: int
    queries: tuple[tuple[int, Sighting], ...]


def make_clip(state: RigidPointsState, frame: MultiViewFrame, min_frames: int) -> Clip:
    """Returns the clip for a new frame; it has at least `min_frames` frames."""
    known = (state.start, *state.recent)
    newest = len(known)
    repeated = max(1, min_frames - newest)
    frames = (*(sighting.frame for sighting in known), *(frame,) * repeated)
    return Clip(frames, newest, tuple(enumerate(known[:2])))


class ClipTracker(RigidPointsTracker):
    """Tracks points by a model in a process of its own; a `Tracker`.

    Each frame is tracked from a clip of frames that the state holds, so the process knows nothing
    else. `start` starts the process, if none runs, and tracks once, which also compiles kernels. If
    the process dies, answers with an error or does not answer in time, `start` and `step` raise a
    TrackingError with the reason. The next `start` replaces a process that has ended.
    """

    def __init__(self, config: ModelEnvironment, *, model: str, min_frames: int, window: int):
        """Checks the environment; the process starts later.

        Args:
            config: Where the model runs.
            model: The model's name in `model_script.py`.
            min_frames: Least number of frames in a clip; the last is repeated.
            window: Largest number of frames in a clip.

        Raises:
            MissingDependencyError: if the environment, the repository or the weights are missing.
        """
        check_environment(config)
        config.check_licence()
        super().__init__(support_points=config.support_points, memory=window - 2)
        self._environment, self._model, self._min_frames = config, model, min_frames
        self._process: ClipProcess | None = None

    def __getstate__(self) -> dict[str, Any]:
        """Supports pickling: a copy starts its own process."""
        return {**self.__dict__, "_process": None}

    @property
    def pid(self) -> int | None:
        """The model's process ID; None while no process runs."""
        return None if self._process is None else self._process.pid

    def start(
        self,
        frame: MultiViewFrame,
        query_points: np.ndarray,
        object_masks: tuple[np.ndarray, ...],
    ) -> TrackerOutput:
        """Starts tracking; see `RigidPointsTracker.start`."""
        output = super().start(frame, query_points, object_masks)
        if self.pid is None:
            self.close()
            self._process = ClipProcess(self._environment, model=self._model, encode=self._encode)
        clip = make_clip(output.state, frame, self._min_frames)
        try:
            self._observe(output.state, clip, self._environment.load_timeout)
        except TrackingError:
            self.close()  # So that the next start loads the model again.
            raise
        return output

    def close(self) -> None:
        """Ends the process. A later `start` starts a new one."""
        if self._process is not None:
            self._process.end()
            self._process = None

    @abstractmethod
    def _encode(self, frame: MultiViewFrame) -> Mapping[str, np.ndarray]:
        """Returns the arrays of a frame that the model needs."""

    @abstractmethod
    def _observe(self, state: RigidPointsState, clip: Clip, timeout: float) -> Matches:
        """Returns where the clip's newest frame shows `state.points`, by calling `_ask`."""

    def _ask(
        self, clip: Clip, request: Mapping[str, np.ndarray], timeout: float
    ) -> dict[str, np.ndarray]:
        """Returns the model's answer; see `ClipProcess.ask`."""
        if self._process is None:
            raise TrackingError(
                f"{self._environment.name} does not run.", remedy="Start tracking again."
            )
        return self._process.ask(clip.frames, request, timeout=timeout)

    def _match(
        self, state: RigidPointsState, frame: MultiViewFrame, predicted: np.ndarray
    ) -> Matches:
        clip = make_clip(state, frame, self._min_frames)
        return self._observe(state, clip, self._environment.timeout)
