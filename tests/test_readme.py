"""The README's code is the example's, and the example does what `poil run` does."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
EXAMPLE = (ROOT / "examples" / "first_diagram.py").read_text()
TELL_STATE = """
    import hashlib
    plant = loop.station.plant()
    state = plant.GetPositionsAndVelocities(plant.GetMyContextFromRoot(simulator.get_context()))
    print(hashlib.sha256(state.tobytes()).hexdigest())
"""


def test_the_readmes_first_diagram_is_the_example() -> None:
    readme = (ROOT / "README.md").read_text()
    example = EXAMPLE.split("\n\n", 1)[1]
    indented = "\n".join(f"    {line}" if line else "" for line in example.strip().splitlines())
    assert indented in readme


@pytest.mark.slow
@pytest.mark.render
def test_the_example_ends_to_the_last_bit_as_the_run_of_another_process(
    tmp_path: Path, whole_run: Path
) -> None:
    # Demonstration, transfer, grasp, closed loop, with other hashes, addresses and timing.
    figures = json.loads((whole_run / "run.json").read_text())
    assert EXAMPLE.count("AdvanceTo(16.0)") == 1
    assert 15.0 < figures["timing"]["simulated"] <= 16.0
    script = EXAMPLE.replace("AdvanceTo(16.0)", f"AdvanceTo({figures['timing']['simulated']})")

    done = subprocess.run(
        [sys.executable, "-c", script + TELL_STATE],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )

    assert done.returncode == 0, done.stderr
    page, digest = done.stdout.splitlines()
    assert page.startswith("http://localhost:")
    assert digest == figures["final_state_digest"]
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["demo.mcap"]
    recorded = [folder / "demo.mcap" for folder in (tmp_path / "out", whole_run)]
    assert recorded[0].read_bytes() == recorded[1].read_bytes()
