import gc
import sys
from pathlib import Path

import numpy as np
import pytest
from small_frames import make_frame

from poil_drake.errors import TrackingError
from poil_drake.perception.trackers.learned import clip_process
from poil_drake.perception.trackers.learned.clip_process import ClipProcess
from poil_drake.perception.trackers.learned.config import MvTrackerConfig

PATIENT = 60.0  # [s]


def start(python: str = sys.executable) -> ClipProcess:
    return ClipProcess(
        MvTrackerConfig(python=python),
        model="mvtracker",
        encode=lambda frame: {"rgb": frame.images[0].rgb, "depth": frame.images[0].depth},
    )


@pytest.fixture
def dut(monkeypatch):
    monkeypatch.setattr(clip_process, "_SCRIPT", str(Path(__file__).with_name("counting_model.py")))
    process = start()
    yield process
    process.end()


def test_each_frame_is_sent_once_and_forgotten_with_the_last_reference(dut):
    frames = [make_frame(k) for k in range(3)]

    first = dut.ask([*frames[:2], frames[1]], {}, timeout=PATIENT)
    second = dut.ask(frames, {"queries": np.zeros((1, 4))}, timeout=PATIENT)
    del frames[0]
    gc.collect()
    third = dut.ask(frames, {}, timeout=PATIENT)

    assert [(int(a["new"]), int(a["kept"])) for a in (first, second, third)] == [
        (2, 2),
        (1, 3),
        (0, 2),
    ]


def test_an_interpreter_that_cannot_run_is_named():
    with pytest.raises(TrackingError, match=r"process of MVTracker cannot be started: .*nowhere"):
        start("nowhere/python")
