"""Finds the Panda's description files in the PyPI package `example-robot-data`."""

import importlib.metadata
from pathlib import Path

from poil_drake.errors import MissingDependencyError

_PACKAGE = "example-robot-data"
_DIRECTORY = "cmeel.prefix/share/example-robot-data/robots/panda_description"
_URDF = "urdf/panda_collision.urdf"


def panda_description_directory() -> Path:
    """Returns the directory that holds the Panda's `urdf/` and `meshes/`.

    Raises:
        MissingDependencyError: when the package `example-robot-data` is not installed.
    """
    try:
        located = importlib.metadata.distribution(_PACKAGE).locate_file(_DIRECTORY)
        directory = Path(str(located))
        found = (directory / _URDF).is_file()
    except importlib.metadata.PackageNotFoundError:
        found = False
    if not found:
        raise MissingDependencyError(
            f"The Panda's description (PyPI package {_PACKAGE}) was not found.",
            remedy="Install it with: pip install 'example-robot-data>=4.3'",
        )
    return directory


def panda_urdf() -> Path:
    """Returns the path of the Panda's URDF with primitive collision shapes.

    Raises:
        MissingDependencyError: when the package `example-robot-data` is not installed.
    """
    return panda_description_directory() / _URDF
