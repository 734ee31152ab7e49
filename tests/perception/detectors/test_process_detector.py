import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator

import numpy as np
import pytest

from poil_drake.errors import DetectionError, MissingDependencyError
from poil_drake.perception.detectors import process_detector
from poil_drake.perception.detectors.process_detector import ProcessDetector
from poil_drake.perception.detectors.protocol import PartMasks
from poil_drake.perception.images import CameraModel, MultiViewFrame, RgbdImage

SIZE = (12, 16)
FRAME = MultiViewFrame(
    (CameraModel("left", 16, 12, np.eye(3), np.eye(4)),),
    (RgbdImage(np.full((*SIZE, 3), 7), np.ones(SIZE), stamp=0.0),),
)


class StandIn:
    """Does what the object's label says; its masks show where the image is 7."""

    def detect(self, frame: MultiViewFrame, *, object_label: str, part_label: str) -> PartMasks:
        if object_label == "hangs":
            while True:
                time.sleep(60.0)
        if object_label == "dies":
            os.kill(os.getpid(), signal.SIGKILL)
        if object_label == "runs out of memory":
            raise RuntimeError("CUDA out of memory.")
        if object_label == "lacks weights":
            raise MissingDependencyError("No weights.", remedy="Get them.")
        if object_label == "sees nothing":
            raise DetectionError(f"There is no {part_label}.", remedy="Look.")
        masks = tuple(image.rgb[:, :, 0] == 7 for image in frame.images)
        return PartMasks(masks, masks)


@pytest.fixture
def make() -> Iterator[Callable[..., ProcessDetector]]:
    made: list[ProcessDetector] = []

    def construct(timeout: float = 3600.0) -> ProcessDetector:
        made.append(ProcessDetector(StandIn, timeout=timeout))
        return made[-1]

    yield construct
    for detector in made:
        detector.close()


def detect(dut: ProcessDetector, object_label: str) -> PartMasks:
    return dut.detect(FRAME, object_label=object_label, part_label="handle")


def test_masks_and_errors_are_those_of_the_detector_and_the_process_stays(
    make: Callable[..., ProcessDetector],
) -> None:
    dut = make()
    assert dut.pid is None

    masks = detect(dut, "mug")
    pid = dut.pid
    with pytest.raises(DetectionError, match=r"There is no handle\. Look\."):
        detect(dut, "sees nothing")
    with pytest.raises(DetectionError, match=r"No weights\. Get them\."):
        detect(dut, "lacks weights")
    detect(dut, "mug")

    assert masks.part_masks[0].all()
    assert dut.pid == pid not in (None, os.getpid())


@pytest.mark.parametrize(
    ("fault", "reason"),
    [
        ("dies", "has ended with status -9"),
        ("runs out of memory", "failed: RuntimeError: CUDA out of memory"),
    ],
)
def test_a_process_that_fails_is_an_error_and_then_replaced(
    make: Callable[..., ProcessDetector], fault: str, reason: str
) -> None:
    dut = make()

    with pytest.raises(DetectionError, match=f"process {reason}"):
        detect(dut, fault)

    assert detect(dut, "mug").part_masks[0].all()


def test_a_process_that_was_killed_while_idle_is_replaced(
    make: Callable[..., ProcessDetector],
) -> None:
    dut = make()
    detect(dut, "mug")
    killed = dut.pid
    os.kill(killed, signal.SIGKILL)
    os.waitid(os.P_PID, killed, os.WEXITED | os.WNOWAIT)

    assert detect(dut, "mug").part_masks[0].all()
    assert dut.pid != killed


def test_a_process_that_hangs_is_killed(
    make: Callable[..., ProcessDetector], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(process_detector, "_LOADING", 0.0)
    dut = make(timeout=0.2)

    with pytest.raises(DetectionError, match=r"gave no answer within 0\.2 s"):
        detect(dut, "hangs")

    assert dut.pid is None


def test_a_frozen_process_is_killed(make: Callable[..., ProcessDetector]) -> None:
    dut = make(timeout=0.2)
    detect(dut, "mug")  # The first detection has more time.
    os.kill(dut.pid, signal.SIGSTOP)

    with pytest.raises(DetectionError, match="gave no answer"):
        detect(dut, "mug")


def test_the_process_ends_with_the_program() -> None:
    code = (
        "import test_process_detector as test\n"
        "dut = test.ProcessDetector(test.StandIn, timeout=3600.0)\n"
        "test.detect(dut, 'mug')\n"
        "print(dut.pid)\n"
    )
    path = os.pathsep.join(sys.path)

    # The output ends only when the worker, which inherits it, has ended too.
    run = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "PYTHONPATH": path},
    )

    assert run.stdout.strip().isdigit()
    assert run.stderr == ""
