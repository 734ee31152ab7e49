"""The topics, names and keys of a demonstration file, see docs/demonstration_format.md."""

import json
import re
from operator import index

from poil_drake.errors import InvalidValueError

WORLD_FRAME = "world"
TRANSFORM_TOPIC = "/tf"

CAMERAS_KEY = "cameras"
LABEL_IDS_KEY = "label_ids"
WORLD_FRAME_KEY = "world_frame"
SCENARIO_ATTACHMENT = "scenario.yaml"

CAMERA_TOPIC = re.compile(r"/camera/(?P<camera>[^/]+)/(?P<kind>image|depth|calibration|label)")


def camera_topic(camera: str, kind: str) -> str:
    """Returns the topic of a camera's "image", "depth", "label" or "calibration"."""
    return f"/camera/{camera}/{kind}"


def optical_frame(camera: str) -> str:
    """Returns the name of a camera's optical frame in our recordings."""
    return f"{camera}_optical_frame"


def parse_label_ids(text: str) -> dict[str, tuple[int, ...]]:
    """Returns the render labels of each object and part from the metadata `label_ids`.

    Raises:
        InvalidValueError: if it is not a table of labels.
    """
    try:
        return {name: tuple(index(i) for i in ids) for name, ids in json.loads(text).items()}
    except (ValueError, TypeError, AttributeError, RecursionError) as error:
        raise InvalidValueError(
            f"the metadata '{LABEL_IDS_KEY}' is not a JSON table of labels: {text[:80]}.",
            remedy='Give lists of render labels, e.g. {"mug": [3, 4]}.',
        ) from error
