"""The user's cache directory, where models made on first use are kept."""

import os
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path


def user_cache_directory() -> Path:
    """Returns `$XDG_CACHE_HOME/poil_drake`, or `~/.cache/poil_drake` where that is not set."""
    root = os.environ.get("XDG_CACHE_HOME")
    return (Path(root) if root else Path.home() / ".cache") / "poil_drake"


def cached_directory(*, name: str, version: str, make: Callable[[Path], None]) -> Path:
    """Returns a directory of generated files, which is made when it is not there yet.

    The directory appears whole or not at all, so that processes may ask for it at the same time
    and an interrupted one leaves nothing half-made behind.

    Args:
        name: What the directory holds, e.g. "panda".
        version: Tells apart contents made from different inputs or by different code.
        make: Writes the files into the (empty) directory that it is given.
    """
    target = user_cache_directory() / f"{name}-{version}"
    if target.is_dir():
        return target
    target.parent.mkdir(parents=True, exist_ok=True)
    scratch = Path(tempfile.mkdtemp(prefix=f".{name}-", dir=target.parent))
    try:
        make(scratch)
        scratch.chmod(0o755)
        try:
            scratch.rename(target)
        except OSError:
            # Another process was faster: its directory holds the same files.
            if not target.is_dir():
                raise
    finally:
        shutil.rmtree(scratch, ignore_errors=True)
    return target
