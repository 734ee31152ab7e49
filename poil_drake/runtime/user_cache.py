"""Directories of generated files in the user's cache."""

import os
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path


def cached_directory(*, name: str, version: str, make: Callable[[Path], None]) -> Path:
    """Returns a directory of generated files, after generating it if it does not exist yet.

    It is in `$XDG_CACHE_HOME/poil_drake`, or `~/.cache/poil_drake` if that is not set. It appears
    whole or not at all. So several processes may request it at the same time, and an interrupted
    process never leaves an incomplete directory under its name.

    Args:
        name: Name of the contents, e.g. "panda".
        version: Distinguishes contents made from different inputs or by different code.
        make: Writes the files into the empty directory that is its argument.
    """
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "poil_drake"
    target = cache / f"{name}-{version}"
    if target.is_dir():
        return target
    cache.mkdir(parents=True, exist_ok=True)
    scratch = Path(tempfile.mkdtemp(prefix=f".{name}-", dir=cache))
    try:
        make(scratch)
        scratch.chmod(0o755)
        try:
            scratch.rename(target)
        except OSError:
            # Another process was faster; its directory has the same files.
            if not target.is_dir():
                raise
    finally:
        shutil.rmtree(scratch, ignore_errors=True)
    return target
