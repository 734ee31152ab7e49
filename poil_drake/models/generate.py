"""Writes the generated models into the package: `python -m poil_drake.models.generate`."""

from pathlib import Path

from poil_drake.models.bag_sdf import BagParameters, write_bag
from poil_drake.models.mug_family import NAMED_MUGS
from poil_drake.models.mug_sdf import write_mug

MODELS_DIRECTORY = Path(__file__).parent
"""Where `package://poil_drake` points."""


def main() -> None:
    """Writes every named mug to `mugs/<name>/`, and the bag."""
    for mug in NAMED_MUGS:
        write_mug(mug, MODELS_DIRECTORY / "mugs" / mug.name)
    bag = BagParameters()
    write_bag(bag, MODELS_DIRECTORY / "bags" / bag.name)


if __name__ == "__main__":
    main()
