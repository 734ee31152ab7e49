"""Runs a detector in another process, which may hang, die or run out of memory."""

from collections.abc import Callable
from threading import Event, Lock, Timer

from poil_drake.errors import DetectionError, PoilError
from poil_drake.perception.detectors.protocol import Detector, PartMasks
from poil_drake.perception.images import MultiViewFrame
from poil_drake.runtime.worker_process import WorkerEndedError, WorkerProcess, serve

_LOADING = 300.0
"""Time for imports and for loading weights, before the first detection of a process [s]."""


class ProcessDetector:
    """Runs another detector in a worker process; a `Detector` itself.

    The worker starts at the first detection, and keeps the model for all further ones. If a
    detection fails in another way than by a `PoilError`, the worker ends, and the next detection
    starts a new one. Several threads may call `detect`; one detection runs at a time.
    """

    def __init__(self, make: Callable[[], Detector], *, timeout: float):
        """Constructs the detector, without starting the worker.

        Args:
            make: Makes the detector, in the worker. It is pickled, and its module must be
                importable.
            timeout: Longest time of a detection [s]. The first one of a worker has five minutes
                more, to load the model.
        """
        self._make, self._timeout = make, timeout
        self._worker: WorkerProcess | None = None
        self._lock = Lock()

    @property
    def pid(self) -> int | None:
        """The worker's process ID; None while there is no worker."""
        return None if self._worker is None else self._worker.pid

    def detect(self, frame: MultiViewFrame, *, object_label: str, part_label: str) -> PartMasks:
        """Returns the masks of the object and of its part in each view; see `Detector.detect`.

        Raises:
            DetectionError: also if the process hangs or dies, or if the detector fails in any other
                way, e.g. for lack of memory.
        """
        with self._lock:
            timeout, is_late = self._timeout, Event()
            if self._worker is None or not self._worker.alive:
                self._end()
                timeout += _LOADING
                self._worker = WorkerProcess(f"{__package__}.process_detector", self._make)
            worker = self._worker

            def stop() -> None:
                is_late.set()
                worker.kill()

            timer = Timer(timeout, stop)
            timer.start()
            try:
                return worker.ask((frame, object_label, part_label))
            except WorkerEndedError as error:
                self._end()
                late = f"gave no answer within {timeout:g} s"
                raise _failed(late if is_late.is_set() else str(error)) from error
            except RuntimeError as error:  # Any other error in the worker, e.g. of its GPU.
                self._end()
                raise _failed(f"failed: {str(error).strip().splitlines()[-1]}") from error
            except PoilError as error:
                raise DetectionError(error.problem, remedy=error.remedy) from error
            finally:
                timer.cancel()

    def close(self) -> None:
        """Ends the worker. A later detection starts a new one."""
        with self._lock:
            self._end()

    def _end(self) -> None:
        if self._worker is not None:
            self._worker.kill()  # It may be too busy to end by itself.
            self._worker.end()
            self._worker = None


def _make_handler(
    make: Callable[[], Detector],
) -> Callable[[tuple[MultiViewFrame, str, str]], PartMasks]:
    detector = make()
    return lambda request: detector.detect(
        request[0], object_label=request[1], part_label=request[2]
    )


def _failed(reason: str) -> DetectionError:
    return DetectionError(
        f"The detector's process {reason}.",
        remedy="Check its output, and whether the memory of the computer or of its GPU ran out. A "
        "slow model may need a larger timeout.",
    )


if __name__ == "__main__":
    serve(_make_handler)
