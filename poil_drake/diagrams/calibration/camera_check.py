"""Checks the depth of a scenario's cameras."""

from pathlib import Path

from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.diagrams.station.station import CaptureScene
from poil_drake.perception.calibration.depth_check import check_depth
from poil_drake.recording.demonstration.demonstration import load_demonstration
from poil_drake.reports.camera_doctor import camera_findings
from poil_drake.reports.finding import Finding


def ExamineCameras(
    scenario: Scenario, *, hardware: bool = False, recording: Path | None = None
) -> list[Finding]:
    """Compares the depth of cameras with the table of a scenario, and with each other.

    Args:
        scenario: The cameras, and the height of the table.
        hardware: Whether to use the real cameras instead of rendered images. The robot is not
            needed; nothing is sent to it.
        recording: A demonstration (MCAP), whose first frame and camera poses are used instead.

    Raises:
        PoilError: if there are no cameras, or no images.
    """
    if recording is not None:
        frame = load_demonstration(recording).frames[0]
    else:
        frame = CaptureScene(scenario, hardware=hardware)
    return camera_findings(check_depth(frame, scenario.poil.table_height))
