"""The set-up script's check of system libraries, for a user who may not install any."""

import os
import subprocess
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[1] / "scripts" / "system_libraries.sh"


def check(folder: Path, **programs: str) -> subprocess.CompletedProcess:
    """Runs the script with stand-ins for programs, for a user who is not root."""
    for name, text in ({"id": "echo 1000", "apt-get": "exit 1"} | programs).items():
        program = folder / name
        program.write_text(f"#!/bin/sh\n{text}\n")
        program.chmod(0o755)
    return subprocess.run(
        ["bash", SCRIPT],
        env={**os.environ, "PATH": f"{folder}:{os.environ['PATH']}"},
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.render  # a machine that renders has all libraries
def test_without_missing_libraries_there_is_no_output(tmp_path: Path) -> None:
    result = check(tmp_path)

    assert (result.returncode, result.stdout, result.stderr) == (0, "", "")


def test_missing_libraries_are_named_with_the_command_that_installs_them(tmp_path: Path) -> None:
    result = check(tmp_path, ldconfig="echo libGL.so.1 libgomp.so.1 libusb-1.0.so.0")

    assert result.returncode == 1
    assert "System libraries are missing: libegl1" in result.stderr
    assert "sudo sh -c 'apt-get update && apt-get install -y" in result.stderr
    assert "libusb" not in result.stderr
