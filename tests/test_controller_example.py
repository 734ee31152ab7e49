"""The example of the controller alone runs and arrives."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
AS_FAST_AS_IT_CAN = """
import runpy, sys
from pydrake.systems.analysis import Simulator
Simulator.set_target_realtime_rate = lambda self, rate: None
runpy.run_path(sys.argv[1], run_name="__main__")
"""


@pytest.mark.parametrize("flags", [[], ["--meshcat"]])
def test_the_body_arrives(flags: list[str], tmp_path: Path) -> None:
    done = subprocess.run(
        [
            *(sys.executable, "-c", AS_FAST_AS_IT_CAN),
            *(ROOT / "examples" / "controller_alone.py", *flags),
        ],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )

    assert done.returncode == 0, done.stderr
    errors = [float(e) for e in re.findall(r"^\d s: +([\d.]+) mm", done.stdout, re.MULTILINE)]
    assert len(errors) == 9
    assert errors[0] > 1000.0
    # At 3 / s a few mm die out within a second or two; the integrator is good to a tenth of one.
    assert errors[-1] <= 0.1
    assert not list(tmp_path.iterdir())
