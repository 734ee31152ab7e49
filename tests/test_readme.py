"""The README's code is the example's, and the example runs."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent


def test_the_readmes_first_diagram_is_the_example() -> None:
    readme = (ROOT / "README.md").read_text()
    example = (ROOT / "examples" / "first_diagram.py").read_text().split("\n\n", 1)[1]
    indented = "\n".join(f"    {line}" if line else "" for line in example.strip().splitlines())
    assert indented in readme


@pytest.mark.slow
@pytest.mark.render
def test_the_example_runs(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, ROOT / "examples" / "first_diagram.py"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )

    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("http://localhost:")
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["demo.mcap"]
