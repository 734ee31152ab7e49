"""The process of a learned tracker's model, which is asked about clips of frames."""

import weakref
from collections.abc import Callable, Mapping, Sequence
from itertools import count
from pathlib import Path
from weakref import WeakKeyDictionary

import numpy as np

from poil_drake.errors import TrackingError
from poil_drake.perception.images import MultiViewFrame
from poil_drake.perception.trackers.learned.config import ModelEnvironment
from poil_drake.runtime.script_process import ScriptProcess, ScriptProcessError

_SCRIPT = str(Path(__file__).with_name("model_script.py"))

Encode = Callable[[MultiViewFrame], Mapping[str, np.ndarray]]


class ClipProcess:
    """Runs a model in another Python environment.

    Each frame is sent once; the process keeps its copy as long as the frame lives here.
    """

    def __init__(self, config: ModelEnvironment, *, model: str, encode: Encode):
        """Starts the process, without waiting until it is ready.

        Args:
            config: Where the model runs.
            model: The model's name in `model_script.py`.
            encode: Returns the arrays of a frame that the model needs.

        Raises:
            TrackingError: if the environment's interpreter cannot be run.
        """
        self._name, self._encode = config.name, encode
        self._numbers: WeakKeyDictionary[MultiViewFrame, int] = WeakKeyDictionary()
        self._next_number = count()
        self._forgotten: list[int] = []  # numbers of frames that live no more
        setup = {"model": model, "device": config.device}
        setup |= {"repository": config.repository, "weights": config.weights}
        try:
            self._process = ScriptProcess(config.python, _SCRIPT, setup)
        except ScriptProcessError as error:
            raise self._failed(str(error)) from error

    @property
    def pid(self) -> int | None:
        """The process ID; None once it has ended."""
        return self._process.pid if self._process.alive else None

    def ask(
        self,
        clip: Sequence[MultiViewFrame],
        request: Mapping[str, np.ndarray],
        *,
        timeout: float,
    ) -> dict[str, np.ndarray]:
        """Returns the model's answer to a request about a clip.

        Args:
            clip: The frames.
            request: Other arrays, by name.
            timeout: Time after which a process that has not answered is killed [s].

        Raises:
            TrackingError: if there is no answer, or if it holds only zeros, with which a model
                answers a clip that is too short.
        """
        forgotten = self._forgotten[:]
        del self._forgotten[: len(forgotten)]
        new: dict[str, np.ndarray] = {}
        for frame in clip:
            if frame not in self._numbers:
                arrays, number = self._encode(frame), next(self._next_number)
                new |= {f"{number}/{name}": array for name, array in arrays.items()}
                self._numbers[frame] = number
                weakref.finalize(frame, self._forgotten.append, number)
        numbers = {"clip": [self._numbers[frame] for frame in clip], "forgotten": forgotten}
        lists = {name: np.array(values, dtype=np.int64) for name, values in numbers.items()}
        try:
            answer = self._process.ask({**lists, **new, **request}, timeout=timeout)
        except ScriptProcessError as error:
            raise self._failed(str(error)) from error
        if not any(array.any() for name, array in answer.items() if name.startswith("tracks")):
            raise self._failed("has returned no tracks")
        return answer

    def end(self) -> None:
        """Ends the process; see `ScriptProcess.end`."""
        self._process.end()

    def _failed(self, reason: str) -> TrackingError:
        return TrackingError(
            f"The process of {self._name} {reason}.",
            remedy="Start tracking again. Check its output, and whether memory ran out.",
        )
