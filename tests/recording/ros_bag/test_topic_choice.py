"""The topics of cameras, as their drivers name them."""

import pytest

from poil_drake.errors import DemonstrationError
from poil_drake.recording.ros_bag.bag import (
    CAMERA_INFO,
    COMPRESSED_IMAGE,
    IMAGE,
    TRANSFORMS,
    BagTopic,
)
from poil_drake.recording.ros_bag.topic_choice import choose_topics

STRING = "std_msgs/msg/String"


class FakeBag:
    """What `choose_topics` reads of a bag."""

    path = "bag"

    def __init__(self, **types: list[str]):
        kinds = {"images": IMAGE, "compressed": COMPRESSED_IMAGE, "infos": CAMERA_INFO}
        self.topics = {
            topic: BagTopic(kinds.get(key, key), 5)
            for key, names in types.items()
            for topic in names
        }

    def listing(self) -> str:
        return f"The bag holds {len(self.topics)} topics."


def bag_below(prefix: str, **names: str) -> FakeBag:
    """Returns a bag with topics by kind, whose names below the prefix are separated by spaces."""
    return FakeBag(
        **{kind: [f"{prefix}/{n}" for n in text.split()] for kind, text in names.items()}
    )


REALSENSE = bag_below(
    "/left",
    images="color/image_raw depth/image_rect_raw infra1/image_rect_raw "
    "aligned_depth_to_color/image_raw aligned_depth_to_infra1/image_raw",
    infos="color/camera_info depth/camera_info infra1/camera_info "
    "aligned_depth_to_color/camera_info",
)
RAW_DEPTH = bag_below(
    "/left",
    images="color/image_raw depth/image_rect_raw",
    compressed="color/image_raw/compressed depth/image_rect_raw/compressedDepth",
    infos="color/camera_info depth/camera_info",
)
COMPRESSED = bag_below(
    "/left",
    compressed="color/image_raw/compressed color/image_raw/compressedDepth "
    "aligned_depth_to_color/image_raw/compressed "
    "aligned_depth_to_color/image_raw/compressedDepth",
    infos="color/camera_info",
)
ZED = bag_below(
    "/zed/zed_node",
    images="rgb/image_rect_color left/image_rect_color depth/depth_registered "
    "confidence/confidence_map",
    infos="rgb/camera_info depth/camera_info",
)
AZURE = bag_below(
    "",
    images="rgb/image_raw depth/image_raw depth_to_rgb/image_raw ir/image_raw",
    infos="rgb/camera_info depth_to_rgb/camera_info depth/camera_info",
)
OPENNI = bag_below(
    "/camera",
    images="rgb/image_raw depth/image_raw depth_registered/image_raw sam/mask",
    infos="rgb/camera_info depth_registered/camera_info",
)


@pytest.mark.parametrize(
    ("bag", "prefix", "image", "depth", "others"),
    [
        (REALSENSE, "/left", "color/image_raw", "aligned_depth_to_color/image_raw", {}),
        (
            *(RAW_DEPTH, "left/", "color/image_raw", "depth/image_rect_raw"),
            {"depth_calibration": "depth/camera_info"},
        ),
        (
            *(COMPRESSED, "/left", "color/image_raw/compressed"),
            *("aligned_depth_to_color/image_raw/compressedDepth", {}),
        ),
        (ZED, "/zed/zed_node", "rgb/image_rect_color", "depth/depth_registered", {}),
        (AZURE, "/", "rgb/image_raw", "depth_to_rgb/image_raw", {}),
        (OPENNI, "/camera", "rgb/image_raw", "depth_registered/image_raw", {"label": "sam/mask"}),
    ],
    ids=["RealSense", "raw depth", "compressed", "ZED", "Azure Kinect", "OpenNI"],
)
def test_topics_of_drivers(bag, prefix, image, depth, others):
    calibration = f"{image.split('/')[0]}/camera_info"
    wanted = {"image": image, "depth": depth, "calibration": calibration} | others

    dut = choose_topics(bag, {"top": prefix}, {})

    below = f"/{prefix.strip('/')}/".replace("//", "/")
    assert dut == {f"/camera/top/{kind}": f"{below}{topic}" for kind, topic in wanted.items()}


def test_given_topics_replace_guesses():
    given = {"top/depth": "/odd/one", "top/calibration": "/left/infra1/camera_info"}
    bag = FakeBag(images=["/odd/one", "/left/image"], infos=["/left/infra1/camera_info"])

    dut = choose_topics(bag, {"top": "/left"}, given)

    assert dut["/camera/top/depth"] == "/odd/one"
    assert dut["/camera/top/calibration"] == "/left/infra1/camera_info"


@pytest.mark.parametrize(
    ("bag", "cameras", "given", "said"),
    [
        (REALSENSE, {}, {}, "no camera is named. The bag holds 9 topics. Name each camera"),
        (REALSENSE, {"cell/left": "/left"}, {}, "'cell/left' cannot be the name of a camera"),
        (REALSENSE, {"left": "/lef"}, {}, "no topic under /lef/ has the image of camera 'left'"),
        (REALSENSE, {"left": "/left/color"}, {}, "no topic under /left/color/ has the depth of"),
        (REALSENSE, {"left": "/left"}, {"lft/depth": "/a"}, "lft/depth names no topic of a camera"),
        (REALSENSE, {"left": "/left"}, {"left/depth": "/a"}, "/a, for the depth of camera 'left',"),
        (
            REALSENSE,
            {"left": "/left"},
            {"left/depth": "/left/depth/camera_info"},
            f"holds {CAMERA_INFO} messages instead of {IMAGE} or {COMPRESSED_IMAGE}",
        ),
        (REALSENSE, {"left": "/left", "right": "/left"}, {}, "serves as /camera/left/image and"),
        (
            FakeBag(images=["/a/rgb/image_raw", "/a/rgb/image_rect_color", "/a/depth"]),
            {"left": "/a"},
            {},
            "both /a/rgb/image_raw and /a/rgb/image_rect_color have the image of camera 'left'",
        ),
        (
            FakeBag(images=["/a/image_raw", "/a/depth/image_raw"]),
            {"left": "/a"},
            {},
            "topic /a/camera_info, for the calibration of camera 'left', is not in the bag",
        ),
        (
            FakeBag(images=["/a/image", "/a/depth"], **{STRING: ["/a/camera_info"]}),
            {"left": "/a"},
            {},
            f"holds {STRING} messages instead of {CAMERA_INFO}",
        ),
        (
            FakeBag(**{TRANSFORMS: ["/tf"]}),
            {"left": "/tf"},
            {},
            "no topic under /tf/ has the image",
        ),
    ],
)
def test_what_is_missing_is_named(bag, cameras, given, said):
    with pytest.raises(DemonstrationError) as error:
        choose_topics(bag, cameras, given)

    assert said in str(error.value)


def test_topics_without_messages_do_not_count():
    bag = FakeBag(images=["/a/image", "/a/depth"], infos=["/a/camera_info"])
    bag.topics |= {"/a/color/image": BagTopic(IMAGE, 0)}

    dut = choose_topics(bag, {"left": "/a"}, {})

    assert dut["/camera/left/image"] == "/a/image"
    with pytest.raises(DemonstrationError, match=r"/a/color/image.* has no messages"):
        choose_topics(bag, {"left": "/a"}, {"left/image": "/a/color/image"})
