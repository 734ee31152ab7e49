"""Renders a station's cameras in a process separate from the simulation."""

import threading
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from poil_drake.diagrams.scenario.load import DumpScenario
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.errors import StationError
from poil_drake.perception.images import RgbdImage
from poil_drake.runtime.worker_process import WorkerEndedError, WorkerProcess


class CameraProcess:
    """A `SceneRenderer` that renders a station's cameras in a separate process.

    The process builds a second station from the same scenario, sets the requested positions of its
    plant, and renders what has changed (see `IncrementalRenderer`). Other changes in the original
    station's context or scene graph do not show. The process starts at the first request.
    """

    def __init__(self, scenario: Scenario, package_xmls: Sequence[str | Path] = ()):
        """Stores the setup, but does not start the process.

        Args:
            scenario: The station's scenario.
            package_xmls: Further `package.xml` files, for `package://` URLs in the directives.
        """
        self._scenario = DumpScenario(scenario, named=False)
        self._package_xmls = [str(Path(path).resolve()) for path in package_xmls]
        self._worker: WorkerProcess | None = None
        self._closed = False
        self._turn = threading.Lock()

    @property
    def pid(self) -> int | None:
        """The process ID; None while there is no process."""
        return None if self._worker is None else self._worker.pid

    def start(self) -> None:
        """Starts the process unless it was started or closed before; does not wait for it."""
        if self._worker is None and not self._closed:
            setup = (self._scenario, self._package_xmls)
            self._worker = WorkerProcess(f"{__package__}.camera_worker", setup)

    def warm_up(self) -> None:
        """Starts the process if needed, and waits for its first images, which take longest.

        Raises:
            PoilError: if the cameras cannot be used.
        """
        self._ask("warm up")

    def render(self, positions: np.ndarray, time: float) -> Mapping[str, RgbdImage]:
        """See `SceneRenderer.render`.

        Raises:
            StationError: if the process has ended.
        """
        return self._ask("render", positions, time)

    def render_labels(self, positions: np.ndarray, time: float) -> Mapping[str, np.ndarray]:
        """See `SceneRenderer.render_labels`.

        Raises:
            StationError: if the process has ended.
        """
        return self._ask("render labels", positions, time)

    def close(self) -> None:
        """Ends the process after its current request. Nothing can be rendered afterwards."""
        with self._turn:
            self._closed = True
            if self._worker is not None:
                self._worker.end()
                self._worker = None

    def _ask(self, *request: Any) -> Any:
        with self._turn:
            self.start()
            if self._worker is None:
                raise StationError(
                    "The cameras' process has been closed.", remedy="Create a new station."
                )
            try:
                return self._worker.ask(request)
            except WorkerEndedError as error:
                raise StationError(
                    f"The cameras' process {error}.",
                    remedy="Check what the process printed, and whether memory ran out. Cameras "
                    "with output_delay 0 need no process.",
                ) from error
