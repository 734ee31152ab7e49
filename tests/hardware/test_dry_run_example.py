"""The example of a dry run on hardware, with `poil driver` as the robot."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from hardware_bench import carrying_plan, hardware_scenario
from labelled_frames import exact_masks
from python_process import run_python
from short_skill import POINTS

from poil_drake.diagrams.scenario.load import DumpScenario
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.diagrams.station.station import CaptureFrame, MakeStation
from poil_drake.geometry.rigid_transform import make_transform
from poil_drake.grasping.execution_plan import ExecutionPlan
from poil_drake.systems.skill.phases import PHASE_NAMES, Phase
from poil_drake.transfer.part_points import view_part

pytestmark = [pytest.mark.render, pytest.mark.real_time]

EXAMPLE = Path(__file__).parent.parent.parent / "examples" / "hardware_dry_run.py"
assert EXAMPLE.name == "hardware_dry_run.py"


def plan_for(scenario: Scenario) -> ExecutionPlan:
    """Returns a plan of two seconds for the object that the scenario's cameras see."""
    with MakeStation(scenario, ignore_output_delay=True) as station:
        frame = CaptureFrame(station, station.CreateDefaultContext(), labels=True)
    view = view_part(frame, exact_masks(frame), scenario.poil.fusion)
    plan = carrying_plan()
    points = view.part.points[np.linspace(0, len(view.part.points) - 1, len(POINTS), dtype=int)]
    shift = make_transform(np.eye(3), points.mean(axis=0) - POINTS.mean(axis=0))
    positions = plan.reference.positions - POINTS + points
    return dataclasses.replace(
        plan,
        target_points=points,
        object_points=view.whole.points,
        part_points=view.part.points,
        reference=dataclasses.replace(plan.reference, positions=positions),
        grasp=dataclasses.replace(plan.grasp, X_WG=shift @ plan.grasp.X_WG),
    )


def test_a_dry_run_goes_through_the_whole_skill(
    scenario: Scenario, time_scale: float, tmp_path: Path
) -> None:
    plan_for(scenario).save(tmp_path / "plan.npz")
    file = tmp_path / "scenario.yaml"
    # The driver renders beside the loop: half the pace that the loop alone keeps.
    slow = hardware_scenario(scenario, time_scale=time_scale / 2, speed=1.0)
    poil = dataclasses.replace(slow.poil, detector=scenario.poil.detector)
    file.write_text(DumpScenario(dataclasses.replace(slow, poil=poil)))

    said = run_python(EXAMPLE, tmp_path / "plan.npz", tmp_path / "out", file)

    assert "the whole motion was shown; nothing was sent to the robot" in said
    phases = json.loads((tmp_path / "out" / "run.json").read_text())["phases"]
    assert [phase["name"] for phase in phases] == list(PHASE_NAMES[: Phase.DONE + 1])
