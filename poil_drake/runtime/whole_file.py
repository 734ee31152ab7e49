"""Files that appear whole or not at all."""

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO


@contextmanager
def whole_file(path: Path) -> Iterator[BinaryIO]:
    """Yields a binary file to write to, which takes the path's place once it is closed.

    Where writing fails, what was at the path stays there. So readers never see half a file, and
    several processes may write the same one. Folders are made where needed. What is there and is no
    regular file, such as /dev/stdout, is written to directly.

    Args:
        path: Where the file goes; a link is followed.

    Raises:
        OSError: if it cannot be written.
    """
    # Asked before the link is followed: those to pipes lead to no path.
    if path.exists() and not path.is_file():
        with path.open("wb") as file:
            yield file
        return
    path = path.resolve()
    path.parent.mkdir(parents=True, exist_ok=True)
    scratch = path.with_name(f".{path.name}.{secrets.token_hex(4)}")
    try:
        # Not a temporary file of the standard library, which nobody else may read.
        with scratch.open("xb") as file:
            yield file
        os.replace(scratch, path)
    finally:
        scratch.unlink(missing_ok=True)
