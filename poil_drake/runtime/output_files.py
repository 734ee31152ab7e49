"""Whether files can be written, asked before the work whose result they shall hold."""

import tempfile
from collections.abc import Sequence
from pathlib import Path

from poil_drake.errors import PoilError


class OutputError(PoilError):
    """An output cannot be written where it shall go."""


def require_writable(path: Path, *, inputs: Sequence[str | Path | None] = ()) -> None:
    """Checks that a file can be written; its folder is made where needed, the file is left alone.

    Args:
        path: Where the output goes.
        inputs: Files that are read and must stay; None stands for none.

    Raises:
        OutputError: when it cannot, or is one of the inputs.
    """
    for given in inputs:
        if given and path.resolve() == Path(given).resolve():
            raise OutputError(
                f"The output '{path}' would overwrite the input '{given}'.",
                remedy="Name another file.",
            )
    if path.is_dir():
        raise OutputError(
            f"The output '{path}' is a folder.", remedy="Name a file, e.g. one in that folder."
        )
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=path.parent):
            pass
    except OSError as error:
        raise OutputError(
            f"The output '{path}' cannot be written ({error.strerror}).",
            remedy="Choose a folder that can be written to.",
        ) from error
