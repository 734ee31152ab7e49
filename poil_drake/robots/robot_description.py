"""Finds the Panda's description files in the PyPI package `example-robot-data`."""

import importlib.metadata
from pathlib import Path

from poil_drake.errors import MissingDependencyError

_PACKAGE = "example-robot-data"
_DIRECTORY = "cmeel.prefix/share/example-robot-data/robots/panda_description"


def panda_description_directory() -> Path:
    """Returns the directory that holds the Panda's `urdf/` and `meshes/`.

    Raises:
        MissingDependencyError: when the package `example-robot-data` is not installed.
    """
    try:
        directory = importlib.metadata.distribution(_PACKAGE).locate_file(_DIRECTORY)
    except importlib.metadata.PackageNotFoundError as error:
        raise MissingDependencyError(
            f"The Panda's description (PyPI package {_PACKAGE}) was not found.",
            remedy="Install it with: pip install 'example-robot-data>=4.3'",
        ) from error
    return Path(str(directory))


def panda_urdf() -> Path:
    """Returns the URDF of the Panda with primitive collision shapes.

    Raises:
        MissingDependencyError: when the package `example-robot-data` is not installed.
    """
    return panda_description_directory() / "urdf" / "panda_collision.urdf"
