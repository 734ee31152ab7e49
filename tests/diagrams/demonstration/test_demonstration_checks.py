import numpy as np
import pytest
from bare_mugs import write_bare_mug
from moved_scene import LABELLED, SMALL, moved

from poil_drake.diagrams.demonstration.recorder import RecordDemonstration
from poil_drake.diagrams.scenario.load import ChooseScenario, LoadScenario
from poil_drake.errors import ScenarioError
from poil_drake.recording.demonstration.demonstration import load_demonstration

pytestmark = pytest.mark.render


def keyframes(*heights: float) -> str:
    """A motion of the mug from height to height [m], beside the rack."""
    frames = [f"{{time: {t}, translation: [0.45, -0.1, {z}]}}" for t, z in enumerate(heights)]
    return f"  demonstration_motion: {{keyframes: [{', '.join(frames)}]}}\n"


@pytest.mark.parametrize(
    ("changes", "problem", "remedy"),
    [
        (keyframes(-0.02, 0.1), r"inside 'table::table::top' at its start", "keyframes"),
        (keyframes(-0.3, 0.1), r"starts in the air", "keyframes"),
        (
            keyframes(0.0, 0.1, -0.05),
            r"'table::table::top' \d\.\d+ s after its start",
            "keyframes",
        ),
        (keyframes(0.02, 0.1), r"starts in the air, .*\(0.450, -0.100, 0.020\) m", "keyframes"),
        ("  table_height: -0.2\n", "starts in the air", "poil.table_height"),
        ("  table_height: 0.2\n", "starts in the air", "poil.table_height"),
        (
            "  demonstration_motion: { hanging: { start: [0.55, 0.30] } }\n",
            "inside 'rack::stand::(base|post)' at its start",
            "hanging.start",
        ),
        (
            "  demonstration_motion: { keyframes: [ { translation: [0.45, -0.1, 0] },"
            " { time: 1, translation: [0.55, 0.3, 0.1] } ] }\n",
            r"inside 'rack::stand::(base|post)' \d\.\d+ s after its start",
            "keyframes",
        ),
        (
            "  demonstration_motion: { hanging: { start: [0.95, 0.6], start_yaw: 90 } }\n",
            "too little of the part 'handle' .* only 0 pixels .* see the object: none",
            "move a camera",
        ),
    ],
)
def test_an_impossible_demonstration_is_refused(changes, problem, remedy, tmp_path):
    with pytest.raises(ScenarioError, match=problem) as info:
        RecordDemonstration(ChooseScenario(data=LABELLED + changes), tmp_path / "demo.mcap")

    assert remedy in info.value.remedy
    assert not (tmp_path / "demo.mcap").exists()


def test_an_object_too_large_for_the_fixture_is_refused(tmp_path):
    mug = write_bare_mug(tmp_path, shapes="boxes", height=0.3)
    own = f"  demonstration_object: {mug}\n  demonstration_parts: {{ handle: 'handle_.*' }}\n"

    with pytest.raises(ScenarioError, match=r"inside 'table::table::top' \d\.\d+ s after") as info:
        RecordDemonstration(ChooseScenario(data=SMALL + own), tmp_path / "demo.mcap")

    assert "smaller object" in info.value.remedy


@pytest.mark.parametrize("size", [(96, 72), (64, 48)])
def test_images_that_are_too_coarse_are_refused(size, tmp_path):
    width, height = size
    coarse = LABELLED.replace("320", str(width)).replace("240", str(height))

    with pytest.raises(ScenarioError, match=r"'left' \(\d+\.\d mm for each pixel\)") as info:
        RecordDemonstration(ChooseScenario(data=coarse), tmp_path / "demo.mcap")

    assert "more pixels (width and height)" in info.value.remedy


@pytest.mark.parametrize(("height", "yaw"), [(0.75, 0.0), (0.3, 135.0)])
def test_a_scene_elsewhere_in_the_world_is_recorded(height, yaw, tmp_path):
    scenario = moved(LoadScenario(data=LABELLED, defaults=ChooseScenario()), height=height, yaw=yaw)

    RecordDemonstration(scenario, tmp_path / "demo.mcap")

    first = load_demonstration(tmp_path / "demo.mcap").frames[0]
    handle = first.label_ids["mug/handle"]
    assert sum(int(np.isin(image.label, handle).sum()) for image in first.images) > 60
