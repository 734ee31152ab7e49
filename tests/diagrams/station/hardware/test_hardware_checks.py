import pytest

from poil_drake.diagrams.scenario.load import ChooseScenario
from poil_drake.diagrams.station.hardware.hardware_checks import CheckHardwareRun
from poil_drake.errors import ScenarioError


def test_the_packages_own_scenario_can_run() -> None:
    CheckHardwareRun(ChooseScenario())


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("tracker: ground_truth", "which hardware does not have.*rigid_flow"),
        ("hardware: {cameras: {left: !RealSense {serial: '1'}}}", "camera 'left' does not provide"),
        ("hardware: {cameras: {right: !OpenCvStreams {rgb: '0', depth: '1'}}}", "camera 'right'"),
        ("hardware: {cameras: {left: !McapPlayback {file: no.mcap}}}", "left plays '.*no.mcap'"),
    ],
)
def test_unsuitable_settings_are_refused(text: str, says: str) -> None:
    with pytest.raises(ScenarioError, match=says):
        CheckHardwareRun(ChooseScenario(data=f"{{poil: {{{text}}}}}"))
