"""Translates the numbers of recorded labels into those of a scenario, by the labels' names."""

from collections.abc import Mapping, Sequence

import numpy as np

LabelIds = Mapping[str, Sequence[int]]


def relabelled(label: np.ndarray, recorded: LabelIds, wanted: LabelIds) -> np.ndarray:
    """Returns a label image in which each object and part has the number of its name in `wanted`.

    A demonstration lacks the robot, so its objects have other numbers than in a run.

    Args:
        label: (H, W) int16.
        recorded: The image's `MultiViewFrame.label_ids`; if empty, the image is returned as it is.
        wanted: Those of the scenario. Pixels whose name it lacks become 0.
    """
    if not recorded:
        return label
    numbers = {name: number for number, name in _names(wanted).items()}
    result = np.zeros_like(label)
    for number, name in _names(recorded).items():
        result[label == number] = numbers.get(name, 0)
    return result


def _names(label_ids: LabelIds) -> dict[int, str]:
    """Returns the name of each number: that of a part, if it is a part's."""
    by_depth = sorted(label_ids, key=lambda name: name.count("/"))
    return {number: name for name in by_depth for number in label_ids[name]}
