"""The topics, names and keys of a demonstration file, see docs/demonstration_format.md."""

import re

WORLD_FRAME = "world"
TRANSFORM_TOPIC = "/tf"

METADATA_RECORD = "poil"
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
