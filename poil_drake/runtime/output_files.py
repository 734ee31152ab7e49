"""Checks files before the work that produces them, and writes them whole or not at all."""

import os
import secrets
import tempfile
from collections.abc import Iterator, Sequence
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
        inputs: Files, and folders with files, that the output must not overwrite; None entries
            are ignored.

    Raises:
        OutputError: if the file cannot be written, or is an input or a file of one.
    """
    own = path.resolve()
    for given in inputs:
        if given and (
            own == Path(given).resolve() or (own.exists() and own.parent == Path(given).resolve())
        ):
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


def require_new(path: Path) -> None:
    """Checks that nothing exists at a path, for outputs that cannot be made again.

    Raises:
        OutputError: if something exists.
    """
    if path.exists():
        raise _exists(path)


def new_file(path: Path) -> BinaryIO:
    """Opens a new binary file. Creates its folder if needed.

    Raises:
        OutputError: if the file exists.
        OSError: if it cannot be created.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        return path.open("xb")
    except FileExistsError as error:
        raise _exists(path) from error


def _exists(path: Path) -> OutputError:
    return OutputError(
        f"'{path}' exists already, and a recording is never overwritten.",
        remedy="Choose another file, or move this one away.",
    )


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
