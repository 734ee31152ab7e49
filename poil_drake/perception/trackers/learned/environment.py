"""Checks whether a learned tracker's environment, repository and weights are there."""

import subprocess
from pathlib import Path

from poil_drake.errors import MissingDependencyError
from poil_drake.perception.trackers.learned.config import ModelEnvironment

_PROBE = "import importlib.metadata as m; print('torch', m.version('torch'))"
_PROBE_TIMEOUT = 30.0  # [s]


def check_environment(config: ModelEnvironment) -> str:
    """Returns a description of what is installed for a learned tracker.

    Raises:
        MissingDependencyError: if anything is missing; the remedy has the commands that get it.
    """
    places = {
        "python": (config.python, Path.is_file, "is no file"),
        "repository": (config.repository, _has_hubconf, "is no folder with hubconf.py"),
        "weights": (config.weights, Path.is_file, "is no file"),
    }
    for field, (place, is_there, problem) in places.items():
        if not place:
            raise _missing(config, f"no path of its {field} is set")
        if not is_there(Path(place)):
            raise _missing(config, f"{field} '{place}' {problem}")
    command = [config.python, "-I", "-c", _PROBE]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=_PROBE_TIMEOUT)
    except (OSError, subprocess.TimeoutExpired) as error:
        raise _missing(config, f"python '{config.python}' does not run: {error}") from error
    if done.returncode != 0:
        reason = (done.stderr.strip().splitlines() or [f"status {done.returncode}"])[-1]
        raise _missing(config, f"python '{config.python}' has no PyTorch: {reason}")
    return f"{done.stdout.strip()}, weights {Path(config.weights).name}"


def _has_hubconf(folder: Path) -> bool:
    return (folder / "hubconf.py").is_file()


def _missing(config: ModelEnvironment, problem: str) -> MissingDependencyError:
    folder = config.repository_url.rpartition("/")[2]
    return MissingDependencyError(
        f"{config.name} is not installed: {problem}.",
        remedy=f"Run: git clone {config.repository_url} && python3.10 -m venv {folder}/.venv && "
        f"{folder}/.venv/bin/pip install torch torchvision -r {folder}/requirements.txt && "
        f"wget {config.weights_url}; then set python, repository and weights in the tracker's "
        "section of poil.tracker_config.",
    )
