"""The versions of the libraries that results depend on."""

import platform
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version

_LIBRARIES = ("poil-drake", "drake", "numpy", "scipy", "torch", "open3d", "pin", "ompl")


def library_versions() -> dict[str, str]:
    """Returns the versions of Python and of the libraries that results depend on."""
    found = {"python": platform.python_version()}
    for name in _LIBRARIES:
        with suppress(PackageNotFoundError):
            found[name] = version(name)
    return found


def version_metadata() -> dict[str, str]:
    """Returns `library_versions` as a file's metadata, with keys such as "poil_drake_version"."""
    versions = library_versions().items()
    return {f"{name.replace('-', '_')}_version": found for name, found in versions}
