"""Mistakes that only planning or execution detects: one line, non-zero status."""

import json
from pathlib import Path
from typing import Any

import pytest
from command_line import Command
from moved_scene import SMALL

from poil_drake.grasping.execution_plan import ExecutionPlan
from poil_drake.recording.demonstration.demonstration import load_demonstration
from poil_drake.recording.demonstration.writer import DemonstrationWriter

pytestmark = pytest.mark.render

OUT_OF_REACH = """
directives:
- add_model: { name: table, file: package://poil_drake/fixtures/table.sdf }
- add_weld: { parent: world, child: table::table }
- add_model: { name: rack, file: package://poil_drake/fixtures/rack.sdf }
- add_weld: { parent: world, child: rack::stand, X_PC: { translation: [0.55, 0.30, 0.0] } }
- add_model: { name: panda, file: package://poil_drake_panda/panda.urdf }
- add_weld:
    parent: world
    child: panda::panda_link0
    X_PC: { translation: [-0.9, 0.0, 0.0] }
- add_model:
    name: mug
    file: package://poil_drake/mugs/mug_a/mug_a.sdf
    default_free_body_pose:
      body: { translation: [0.47, -0.12, 0.0], rotation: !Rpy { deg: [0, 0, 120] } }
poil:
"""


def test_a_part_that_no_camera_sees(command: Command, demonstration: Path, tmp_path: Path) -> None:
    behind = "randomization: {models: [], x: [1.0, 1.0], y: [-0.7, -0.7]}"
    text = f"{{poil: {{demonstration: {demonstration}, {behind}}}}}"

    dut = command("run", "--no-meshcat", "--seed", "0", "--scenario_text", text)

    assert dut.status == 1
    assert "In the view of the scene: None of the" in dut.error
    assert f"poil: {_only_output(tmp_path)['reason']}" in dut.error


def test_an_object_out_of_reach(command: Command, demonstration: Path, tmp_path: Path) -> None:
    text = f"{OUT_OF_REACH}  demonstration: {demonstration}"
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "run.mcap").write_text("of an earlier run")

    dut = command("run", "--no-meshcat", "--scenario_text", text)

    assert dut.status == 1
    assert "feasible" in dut.error
    assert "reach" in dut.error
    figures = _only_output(tmp_path)
    assert figures["success"] is False
    assert f"poil: {figures['reason']}" in dut.error
    assert figures["timing"]["stages"].keys() == {"planning"}


def test_the_error_without_labels_names_what_the_detector_needs(
    command: Command, demonstration: Path, tmp_path: Path
) -> None:
    with DemonstrationWriter(tmp_path / "unlabelled.mcap", ["left", "right"], {}) as writer:
        for frame in load_demonstration(demonstration).frames[1:3]:
            writer.write(frame)

    dut = command("transfer", "unlabelled.mcap", "--detector", "label_image")

    assert dut.status == 1
    assert "unlabelled.mcap" in dut.error
    assert "/camera/<name>/label" in dut.error


def test_a_demonstration_whose_object_no_camera_sees_is_refused_and_stays(
    command: Command, tmp_path: Path
) -> None:
    away = SMALL + "  demonstration_motion: { hanging: { start: [0.95, 0.6], start_yaw: 90 } }\n"

    dut = command("demo", "record", "-o", "demo.mcap", "--scenario_text", away)

    assert dut.status == 1
    assert "No objects left their places" in dut.error
    assert "Record again" in dut.error
    assert (tmp_path / "demo.mcap").exists()


def test_an_unknown_detector_is_named_before_the_scene_is_built(
    command: Command, demonstration: Path
) -> None:
    dut = command("transfer", str(demonstration), "--detector", "magic")

    assert dut.status == 1
    assert "no part detector 'magic'. Choose from: demonstration, " in dut.error


@pytest.mark.parametrize(
    "arguments",
    [
        ["demo", "show", "demo.mcap", "-o", "demo.mcap"],
        ["transfer", "demo.mcap", "-o", "./demo.mcap"],
        ["run", "kitchen.yaml", "--mcap", "demo.mcap"],
        ["run", "kitchen.yaml", "--json", "kitchen.yaml"],
        ["run", "--mcap", "out/demo.mcap", "--json", "out/run.json"],
        ["demo", "record", "kitchen.yaml", "-o", "kitchen.yaml"],
        ["execute", "plan.npz", "--json", "plan.npz"],
    ],
    ids=" ".join,
)
def test_no_output_overwrites_an_input(
    command: Command,
    demonstration: Path,
    plan: ExecutionPlan,
    tmp_path: Path,
    arguments: list[str],
) -> None:
    (tmp_path / "demo.mcap").write_bytes(demonstration.read_bytes())
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "run.html").write_text("of an earlier run")
    (tmp_path / "kitchen.yaml").write_text("Kitchen: { poil: { demonstration: demo.mcap } }")
    plan.save(tmp_path / "plan.npz")
    before = {path: path.read_bytes() for path in tmp_path.rglob("*.*")}

    dut = command(*arguments)

    assert dut.status == 1
    assert "would overwrite the input" in dut.error
    assert {path: path.read_bytes() for path in tmp_path.rglob("*.*")} == before


def _only_output(folder: Path) -> dict[str, Any]:
    """Returns the figures of a run that left nothing else."""
    assert [path.name for path in (folder / "out").iterdir()] == ["run.json"]
    return json.loads((folder / "out" / "run.json").read_text())
