"""Writes the shipped mugs into the package: `python -m poil_drake.models.generate`."""

from pathlib import Path

from poil_drake.models.mug_family import NAMED_MUGS
from poil_drake.models.mug_sdf import write_mug

MODELS_DIRECTORY = Path(__file__).parent
"""Where `package://poil_drake` points."""


def main() -> None:
    """Writes every named mug to `mugs/<name>/`."""
    for mug in NAMED_MUGS:
        write_mug(mug, MODELS_DIRECTORY / "mugs" / mug.name)


if __name__ == "__main__":
    main()
