"""Checks files before the work that produces them; writes files and caches whole or not at all."""

import os
import secrets
import shutil
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from poil_drake.errors import PoilError


class OutputError(PoilError):
    """An output cannot be written to its path."""


def require_writable(path: Path, *, inputs: Sequence[str | Path | None] = ()) -> None:
    """Checks that a file can be written. Creates its folder if needed; does not touch the file.

    Args:
        path: The output.
        inputs: Files that the output must not overwrite; None entries are ignored.

    Raises:
        OutputError: if the file cannot be written, or is one of the inputs.
    """
    for given in inputs:
        if given and path.resolve() == Path(given).resolve():
            raise OutputError(
                f"The output '{path}' would overwrite the input '{given}'.",
                remedy="Choose another output file.",
            )
    if path.is_dir():
        raise OutputError(
            f"The output '{path}' is a folder.", remedy="Choose a file, e.g. one in that folder."
        )
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=path.parent).close()
    except OSError as error:
        raise OutputError(
            f"The output '{path}' cannot be written ({error.strerror}).",
            remedy="Choose a folder in which you may create files.",
        ) from error


@contextmanager
def whole_file(path: Path) -> Iterator[BinaryIO]:
    """Yields a new binary file, which replaces `path` at the end of the `with` block.

    If the block raises an exception, the old file stays. Readers therefore never see half a file,
    and several processes may write to the same path. Folders are created if needed. If `path` is
    not a regular file, e.g. /dev/stdout, the block writes to it directly.

    Args:
        path: The file; symbolic links are followed.

    Raises:
        OSError: if the file cannot be written.
    """
    # Checked before links are resolved, because a link to a pipe resolves to no existing path.
    if path.exists() and not path.is_file():
        with path.open("wb") as file:
            yield file
        return
    path = path.resolve()
    path.parent.mkdir(parents=True, exist_ok=True)
    scratch = path.with_name(f".{path.name}.{secrets.token_hex(4)}")
    try:
        # Not a `tempfile`, because other users could not read it.
        with scratch.open("xb") as file:
            yield file
        os.replace(scratch, path)
    finally:
        scratch.unlink(missing_ok=True)


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
