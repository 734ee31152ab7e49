"""Runs Python in a separate process."""

import subprocess
import sys
from pathlib import Path


def run_python(*arguments: object, cwd: Path | None = None) -> str:
    """Runs Python with arguments in a folder, checks that it succeeds and returns its output."""
    command = [sys.executable, *map(str, arguments)]
    done = subprocess.run(command, cwd=cwd, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout
