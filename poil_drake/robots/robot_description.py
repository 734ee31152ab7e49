"""Finds the Panda's description files in the PyPI package `example-robot-data`."""

import importlib.metadata
import site
import sys
from pathlib import Path

from poil_drake.errors import MissingDependencyError

_RELATIVE_PATH = Path("cmeel.prefix/share/example-robot-data/robots/panda_description")


def panda_description_directory() -> Path:
    """Returns the directory that holds the Panda's `urdf/` and `meshes/`.

    Raises:
        MissingDependencyError: when the package `example-robot-data` is not installed.
    """
    try:
        installed_to = [str(importlib.metadata.distribution("example-robot-data").locate_file(""))]
    except importlib.metadata.PackageNotFoundError:
        installed_to = []
    for root in (*installed_to, *sys.path, *site.getsitepackages()):
        candidate = Path(root) / _RELATIVE_PATH
        if (candidate / "urdf" / "panda_collision.urdf").is_file():
            return candidate
    raise MissingDependencyError(
        "The Panda's description (PyPI package example-robot-data) was not found.",
        remedy="Install it with: pip install 'example-robot-data>=4.3'",
    )
