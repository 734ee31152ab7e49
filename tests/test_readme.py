"""The README's code is the example's, and the example does what `poil run` does."""

from pathlib import Path

import pytest
from python_process import run_python

from poil_drake.recording.run_log.reader import load_recorded_run

ROOT = Path(__file__).parent.parent
EXAMPLE = (ROOT / "examples" / "first_diagram.py").read_text()
PRINT_MOTION = """
    station = loop.station
    context = station.GetMyContextFromRoot(simulator.get_context())
    for name in ("panda.position_measured", "panda.velocity_measured"):
        print(*station.GetOutputPort(name).Eval(context))
"""
FOLLOWING = 6.5  # [s]: at this time tracked points move the arm and the mug.


def test_the_readmes_first_diagram_is_the_example() -> None:
    readme = (ROOT / "README.md").read_text()
    example = EXAMPLE.split("\n\n", 1)[1]
    indented = "\n".join(f"    {line}" if line else "" for line in example.strip().splitlines())
    assert indented in readme


@pytest.mark.slow
@pytest.mark.render
def test_the_example_moves_exactly_as_the_run_of_another_process(
    tmp_path: Path, whole_run: Path, demonstration: Path
) -> None:
    # The two processes differ in hash seeds, memory addresses and timing.
    run = load_recorded_run(whole_run / "run.mcap")
    assert 15.0 < run.end <= 16.0
    assert {phase.name: phase.time for phase in run.phases}["follow"] < FOLLOWING - 0.5
    assert EXAMPLE.count("AdvanceTo(16.0)") == 1
    script = EXAMPLE.replace("AdvanceTo(16.0)", f"AdvanceTo({FOLLOWING})")

    page, *motion = run_python("-c", script + PRINT_MOTION, cwd=tmp_path).splitlines()

    assert page.startswith("http://localhost:")
    found = [float(number) for line in motion for number in line.split()]
    assert found == run.joints.at(FOLLOWING)[:14].tolist()
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["demo.mcap"]
    recorded = [tmp_path / "out" / "demo.mcap", whole_run / "demo.mcap", demonstration]
    assert len({path.read_bytes() for path in recorded}) == 1
