"""The example of the controller alone runs and arrives."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent


@pytest.mark.parametrize("flags", [[], pytest.param(["--meshcat"], marks=pytest.mark.slow)])
def test_the_body_arrives(flags: list[str], tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, ROOT / "examples" / "controller_alone.py", *flags],
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
