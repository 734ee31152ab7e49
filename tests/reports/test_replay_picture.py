import cv2
import numpy as np
import pytest
from replay_comparisons import make_run, make_summary

from poil_drake.recording.run_log.recorded_run import RecordedRun
from poil_drake.reports.replay_picture import make_replay_picture


def draw(path, recorded: RecordedRun, replayed: RecordedRun):
    make_replay_picture(
        path,
        summary=make_summary(recorded, replayed),
        recorded=recorded,
        replayed=replayed,
        velocity_limits=np.full(7, 2.0),
    )


def test_signals_of_only_one_run_are_drawn_and_the_folder_is_made(tmp_path):
    replayed = make_run(last="fault")
    replayed.tracks = []

    path = tmp_path / "out" / "replay.png"

    draw(path, make_run(), replayed)

    assert cv2.imread(str(path)).shape == (1080, 1800, 3)


@pytest.mark.parametrize(
    ("speed", "verdict"), [(0.52, " SAME "), (0.75, " DIFFERENT ")], ids=["same", "different"]
)
def test_the_verdict_and_the_axes_are_written(tmp_path, speed, verdict):
    path = tmp_path / "replay.svg"

    draw(path, make_run(), make_run(speed=speed))

    text = path.read_text()
    for text_part in (
        verdict,
        "joint velocity",
        "tracked points",
        "hardware run",
        "follow",
        "tolerance",
    ):
        assert text_part in text
