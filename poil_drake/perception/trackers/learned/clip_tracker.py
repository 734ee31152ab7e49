"""The base of learned trackers: it keeps a clip of frames, and asks a model's process about it."""

import sys
from abc import abstractmethod
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from poil_drake.errors import TrackingError
from poil_drake.perception.images import MultiViewFrame
from poil_drake.perception.trackers.learned.config import ModelEnvironment
from poil_drake.perception.trackers.learned.environment import check_environment
from poil_drake.perception.trackers.protocol import TrackerOutput
from poil_drake.perception.trackers.rigid_points.tracker import (
    Matches,
    RigidPointsState,
    RigidPointsTracker,
    Sighting,
)
from poil_drake.runtime.script_process import ScriptProcess, ScriptProcessError


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

    Each frame is tracked from a clip, and the state holds all frames of the next clip, so the
    process keeps nothing. `start` starts the process, if none runs, and tracks once, which also
    compiles kernels. If the process dies, answers with an error or does not answer in time, `start`
    and `step` raise a TrackingError with the reason; the next `start` starts a new process.
    """

    def __init__(self, config: ModelEnvironment, *, script: str, min_frames: int, window: int):
        """Checks the environment; the process starts later.

        Args:
            config: Where the model runs.
            script: Name of the script in this folder that runs the model.
            min_frames: Least number of frames in a clip; the last is repeated.
            window: Largest number of frames in a clip.

        Raises:
            MissingDependencyError: if the environment, the repository or the weights are missing.
        """
        check_environment(config)
        super().__init__(support_points=config.support_points, memory=window - 2)
        self._environment, self._script = config, str(Path(__file__).with_name(script))
        self._min_frames, self._process = min_frames, None
        _print_once(f"poil: the licence of {config.name}: {config.licence}")

    def __getstate__(self) -> dict[str, Any]:
        """Supports pickling: a copy starts its own process."""
        return {**self.__dict__, "_process": None}

    _process: ScriptProcess | None

    @property
    def pid(self) -> int | None:
        """The model's process ID; None while no process runs."""
        return self._process.pid if self._process is not None and self._process.alive else None

    def start(
        self,
        frame: MultiViewFrame,
        query_points: np.ndarray,
        object_masks: tuple[np.ndarray, ...],
    ) -> TrackerOutput:
        """Starts tracking; see `RigidPointsTracker.start`."""
        output = super().start(frame, query_points, object_masks)
        if self.pid is None:
            self._launch()
        clip = make_clip(output.state, frame, self._min_frames)
        try:
            self._observe(output.state, clip, self._environment.load_timeout)
        except TrackingError:
            self.close()  # A model that could not be loaded is loaded again by the next start.
            raise
        return output

    def close(self) -> None:
        """Ends the process. A later `start` starts a new one."""
        if self._process is not None:
            self._process.end()
            self._process = None

    @abstractmethod
    def _observe(self, state: RigidPointsState, clip: Clip, timeout: float) -> Matches:
        """Returns where the clip's newest frame shows `state.points`, by calling `_ask`."""

    def _match(
        self, state: RigidPointsState, frame: MultiViewFrame, predicted: np.ndarray
    ) -> Matches:
        clip = make_clip(state, frame, self._min_frames)
        return self._observe(state, clip, self._environment.timeout)

    def _launch(self) -> None:
        self.close()
        where = self._environment
        setup = {name: getattr(where, name) for name in ("repository", "weights", "device")}
        try:
            self._process = ScriptProcess(where.python, self._script, setup)
        except ScriptProcessError as error:
            raise self._failed(str(error)) from error

    def _ask(self, request: Mapping[str, np.ndarray], timeout: float) -> dict[str, np.ndarray]:
        """Returns the answer of the model's process.

        Raises:
            TrackingError: if there is no answer, or if it holds only zeros, with which a model
                answers a clip that is too short.
        """
        if self._process is None:
            raise self._failed("does not run")
        try:
            answer = self._process.ask(request, timeout=timeout)
        except ScriptProcessError as error:
            raise self._failed(str(error)) from error
        if not any(array.any() for name, array in answer.items() if name.startswith("tracks")):
            raise self._failed("has returned no tracks")
        return answer

    def _failed(self, reason: str) -> TrackingError:
        return TrackingError(
            f"The process of {self._environment.name} {reason}.",
            remedy="Start tracking again. Check the output of the process, and whether memory ran "
            "out; `poil doctor` checks its environment.",
        )


@cache
def _print_once(line: str) -> None:
    print(line, file=sys.stderr)
