"""Chooses the topics of each camera in a ROS bag."""

import re
from collections.abc import Mapping

from poil_drake.errors import DemonstrationError
from poil_drake.recording.demonstration.layout import CAMERA_TOPIC, camera_topic
from poil_drake.recording.ros_bag.bag import CAMERA_INFO, IMAGE, IMAGES, RosBag

_TYPES = {
    "image": IMAGES,
    "depth": IMAGES,
    "label": IMAGES,
    "calibration": (CAMERA_INFO,),
    "depth_calibration": (CAMERA_INFO,),
}

# Parts of the topics of the drivers of RealSense, ZED, Azure Kinect and OpenNI cameras.
_KINDS = (
    ("label", re.compile("label|mask|segment")),
    ("depth", re.compile("depth")),
    ("other", re.compile("infra|fisheye|confidence|thermal")),
    ("image", re.compile("")),
)
_PREFERRED = {
    "image": re.compile("(^|/)(colou?r|rgb)"),
    "depth": re.compile("registered|_to_(color|rgb)"),
    "label": re.compile(""),
}


def choose_topics(
    bag: RosBag, cameras: Mapping[str, str], given: Mapping[str, str]
) -> dict[str, str]:
    """Returns the bag's topic for each topic of the demonstration, e.g. "/camera/left/image".

    Args:
        bag: An open bag.
        cameras: The prefix of each camera's topics, by the camera's name. Colour, depth and, if
            there are any, label images are found by type and name, and the calibrations as
            `camera_info` beside the images.
        given: Topics that are not guessed, e.g. {"left/depth": "/left/registered/image_raw"}.

    Raises:
        DemonstrationError: if a topic is missing, ambiguous, empty or of another type, or serves
            twice. The message lists what is in the bag.
    """
    if not cameras:
        raise DemonstrationError(
            f"{bag.path}: no camera is named. {bag.listing()}",
            remedy="Name each camera and the prefix of its topics, e.g. --camera left=/left.",
        )
    for name in cameras:
        if CAMERA_TOPIC.fullmatch(camera_topic(name, "image")) is None:
            raise DemonstrationError(
                f"'{name}' cannot be the name of a camera, because it would be part of a topic.",
                remedy="Use letters, digits, '_' and '-'.",
            )
    keys = [f"{name}/{kind}" for name in cameras for kind in _TYPES]
    for key in given:
        if key not in keys:
            raise DemonstrationError(
                f"--topic {key} names no topic of a camera.", remedy=f"Use {', '.join(keys)}."
            )
    chosen: dict[str, str] = {}
    for name, prefix in cameras.items():
        topics = {kind: given.get(f"{name}/{kind}") for kind in _TYPES}
        for kind in _PREFERRED:
            topics[kind] = topics[kind] or _guess(bag, name, kind, prefix)
        color, depth = str(topics["image"]), str(topics["depth"])
        topics["calibration"] = topics["calibration"] or _beside(color)
        # Depth that its driver has registered to colour has the calibration of colour.
        own = _beside(depth)
        if own in bag.topics and own != _beside(color) and not _PREFERRED["depth"].search(depth):
            topics["depth_calibration"] = topics["depth_calibration"] or own
        for kind, topic in topics.items():
            if topic is not None:
                _check(bag, name, kind, topic)
                chosen[camera_topic(name, kind)] = topic
    for topic in chosen.values():
        users = [own for own, other in chosen.items() if other == topic]
        if len(users) > 1:
            raise DemonstrationError(
                f"{bag.path}: topic {topic} serves as {' and '.join(users)}. {bag.listing()}",
                remedy="Give each camera its own prefix with --camera.",
            )
    return chosen


def image_name(topic: str) -> str:
    """Returns a topic of images without its transport, e.g. "/image_raw/compressed"."""
    return topic.removesuffix("/compressed").removesuffix("/compressedDepth")


def _beside(image: str) -> str:
    """Returns the topic of the calibration of a topic of images."""
    return f"{image_name(image).rpartition('/')[0]}/camera_info"


def _guess(bag: RosBag, name: str, kind: str, prefix: str) -> str | None:
    """Returns the topic of a kind of image; None if it is missing and optional."""
    prefix = f"/{prefix.strip('/')}/".replace("//", "/")
    fitting: dict[str, list[str]] = {}  # The topics of each stream: raw, compressed.
    for topic, (message_type, messages) in bag.topics.items():
        if message_type in IMAGES and topic.startswith(prefix) and messages > 0:
            image = image_name(topic)
            if kind == next(k for k, part in _KINDS if part.search(image[len(prefix) :].lower())):
                fitting.setdefault(image, []).append(topic)
    preferred = [i for i in fitting if _PREFERRED[kind].search(i[len(prefix) :].lower())]
    images = preferred or list(fitting)
    if not images and kind == "label":
        return None
    if len(images) != 1:
        found = f"both {' and '.join(images)} have" if images else f"no topic under {prefix} has"
        raise DemonstrationError(
            f"{bag.path}: by its name, {found} the {kind} of camera '{name}'. {bag.listing()}",
            remedy=f"Name the topic, e.g. --topic {name}/{kind}={prefix}{kind}, or another prefix "
            "with --camera.",
        )
    # JPEG, which is usual in `compressed`, would spoil depth and labels.
    lossless, packed = kind != "image", "/compressedDepth"
    return min(
        fitting[images[0]],
        key=lambda topic: (bag.topics[topic].type != IMAGE, topic.endswith(packed) != lossless),
    )


def _check(bag: RosBag, name: str, kind: str, topic: str) -> None:
    """Raises a DemonstrationError unless a topic is there, has messages, and the right type."""
    found = bag.topics.get(topic)
    if found is None:
        problem = "is not in the bag"
    elif found.type not in _TYPES[kind]:
        problem = f"holds {found.type} messages instead of {' or '.join(_TYPES[kind])}"
    elif found.messages == 0:
        problem = "has no messages"
    else:
        return
    raise DemonstrationError(
        f"{bag.path}: topic {topic}, for the {kind} of camera '{name}', {problem}. {bag.listing()}",
        remedy=f"Name another topic, e.g. --topic {name}/{kind}=TOPIC, or record it.",
    )
