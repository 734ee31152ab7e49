"""The topics, names and keys of a demonstration file; see docs/demonstration_format.md."""

import json
import re
from collections.abc import Mapping
from operator import index
from pathlib import Path

from poil_drake.errors import DemonstrationError

WORLD_FRAME = "world"
TRANSFORM_TOPIC = "/tf"
STATIC_TRANSFORM_TOPIC = "/tf_static"

CAMERAS_KEY = "cameras"
LABEL_IDS_KEY = "label_ids"
WORLD_FRAME_KEY = "world_frame"
LIVE_KEY = "live"
"""Marks a recording of a live event, whose metadata comes first. It may be cut off."""
SCENARIO_ATTACHMENT = "scenario.yaml"

CAMERA_TOPIC = re.compile(
    r"/camera/(?P<camera>[^/]+)/(?P<kind>image|depth|calibration|depth_calibration|label)"
)


def camera_topic(camera: str, kind: str) -> str:
    """Returns the topic of a camera's "image", "depth", "label", "calibration", and so on."""
    return f"/camera/{camera}/{kind}"


def optical_frame(camera: str) -> str:
    """Returns the name that poil_drake's recordings give a camera's optical frame."""
    return f"{camera}_optical_frame"


def parse_label_ids(path: Path, metadata: Mapping[str, str]) -> dict[str, tuple[int, ...]]:
    """Returns the render labels of each object and part, from the metadata of a file.

    Raises:
        DemonstrationError: if they are not a JSON object whose values are lists of integers.
    """
    text = metadata.get(LABEL_IDS_KEY, "{}")
    try:
        return {name: tuple(index(i) for i in ids) for name, ids in json.loads(text).items()}
    except (ValueError, TypeError, AttributeError, RecursionError) as error:
        raise DemonstrationError(
            f"{path}: the metadata '{LABEL_IDS_KEY}' is not a JSON object of label lists: "
            f"{text[:80]}.",
            remedy='Use a list of render labels for each name, e.g. {"mug": [3, 4]}.',
        ) from error
