from importlib.metadata import version

import numpy as np
import pytest
from moved_scene import LABELLED, SMALL

from poil_drake.diagrams.demonstration.recorder import RecordDemonstration
from poil_drake.diagrams.scenario.load import ChooseScenario, LoadScenario, default_scenario_file
from poil_drake.errors import ScenarioError
from poil_drake.recording.demonstration.demonstration import load_demonstration

pytestmark = pytest.mark.render


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    path = tmp_path_factory.mktemp("recorder") / "demo.mcap"
    progress = []
    small = ChooseScenario(data=LABELLED)
    count = RecordDemonstration(small, path, progress=lambda *step: progress.append(step))
    return path, count, progress


def test_frames_come_at_the_trackers_rate(recording):
    path, count, progress = recording

    dut = load_demonstration(path)

    # 7.25 s at 1 Hz.
    assert count == 8
    assert progress == [("recording the demonstration", (i + 1) / 8) for i in range(8)]
    np.testing.assert_array_equal(dut.stamps, np.arange(8.0))
    assert [camera.name for camera in dut.cameras] == ["left", "right"]
    assert dut.metadata["scenario"] == "HangMug"
    assert dut.metadata["object"] == "mug_demo"
    assert dut.metadata["seed"] == "0"


def test_the_scenario_and_the_versions_are_in_the_file(recording, tmp_path):
    dut = load_demonstration(recording[0])

    (tmp_path / "scenario.yaml").write_text(dut.scenario_text)
    again = LoadScenario(filename=tmp_path / "scenario.yaml")
    assert again.poil == ChooseScenario(data=LABELLED).poil
    assert again.cameras["right"].width == 320
    assert again.source.name == dut.metadata["scenario"] == "HangMug"
    assert dut.metadata["scenario_file"] == str(default_scenario_file())
    for package in ("poil-drake", "drake", "numpy"):
        assert dut.metadata[f"{package.replace('-', '_')}_version"] == version(package)


@pytest.fixture(scope="module")
def dut(recording):
    return load_demonstration(recording[0]).frames


def test_only_the_first_frame_is_labelled_and_no_robot_is_in_view(dut):
    assert set(dut[0].label_ids) == {"table", "rack", "mug", "mug/handle"}
    for image in dut[0].images:
        assert np.isin(image.label, dut[0].label_ids["mug/handle"]).any()
    assert dut[1].images[0].label is None


def test_the_mug_rests_then_moves_in_all_views(dut):
    for view in range(2):
        mug = np.isin(dut[0].images[view].label, dut[0].label_ids["mug"])
        first = dut[0].images[view].rgb[mug].astype(float)
        last = dut[7].images[view].rgb[mug].astype(float)
        assert np.abs(last - first).mean() > 10


def test_depth_has_the_sensors_noise(dut):
    depths = [frame.images[0].depth for frame in dut]
    still = np.all([depth > 0 for depth in depths], axis=0)
    spread = np.std(depths, axis=0)[still]

    # The table's noise is about a millimetre; without noise it would be 0.
    assert 0.0002 < np.median(spread) < 0.005


def test_the_same_scenario_gives_the_same_file(recording, tmp_path):
    RecordDemonstration(ChooseScenario(data=LABELLED), tmp_path / "again.mcap")

    assert (tmp_path / "again.mcap").read_bytes() == recording[0].read_bytes()


@pytest.fixture(scope="module")
def short(tmp_path_factory):
    """Two seconds with the scenario's detector, which needs no labels."""
    keyframes = """
  demonstration_motion:
    keyframes:
    - { time: 0, translation: [0.45, -0.1, 0.0] }
    - { time: 2, translation: [0.45, 0.0, 0.1], rpy: [0, 0, 90] }
"""
    path = tmp_path_factory.mktemp("short") / "demo.mcap"
    RecordDemonstration(ChooseScenario(data=SMALL + keyframes), path)
    return load_demonstration(path)


def test_keyframes_can_be_given(short):
    np.testing.assert_array_equal(short.stamps, np.arange(3.0))


def test_without_the_label_detector_nothing_is_labelled(short):
    assert not short.frames[0].label_ids
    assert all(image.label is None for frame in short.frames for image in frame.images)


def test_cameras_are_needed(tmp_path):
    with pytest.raises(ScenarioError, match="no cameras"):
        RecordDemonstration(LoadScenario(), tmp_path / "demo.mcap")
