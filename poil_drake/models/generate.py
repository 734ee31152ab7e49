"""Writes the generated models into the package: `python -m poil_drake.models.generate`."""

from pathlib import Path

from poil_drake.models.bag_sdf import BagParameters, write_bag
from poil_drake.models.mug_family import NAMED_MUGS
from poil_drake.models.mug_sdf import write_mug


def main() -> None:
    """Writes every named mug into `mugs/<name>/`, and the bag into `bags/soft_bag/`."""
    directory = Path(__file__).parent
    for mug in NAMED_MUGS:
        write_mug(mug, directory / "mugs" / mug.name)
    write_bag(BagParameters(), directory / "bags" / "soft_bag")


if __name__ == "__main__":
    main()
