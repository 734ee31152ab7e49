import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from poil_drake.systems.cameras.encoded_image_size import encoded_image_size


@pytest.mark.parametrize(
    ("kind", "options"),
    [
        (".png", []),
        (".jpg", []),
        (".jpg", [cv2.IMWRITE_JPEG_PROGRESSIVE, 1, cv2.IMWRITE_JPEG_RST_INTERVAL, 2]),
    ],
)
@pytest.mark.parametrize("size", [(1, 1), (48, 640), (700, 3)])
def test_the_size_is_that_of_the_image(kind: str, options: list[int], size: tuple) -> None:
    data = cv2.imencode(kind, np.zeros((*size, 3), np.uint8), options)[1].tobytes()

    assert encoded_image_size(data) == size


def test_what_stands_before_a_jpegs_frame_is_skipped() -> None:
    data = cv2.imencode(".jpg", np.zeros((4, 6, 3), np.uint8))[1].tobytes()
    comment = b"\xff\xff\xfe" + (2 + 9).to_bytes(2, "big") + b"\xff\xc0" + 7 * b"\x01"

    assert encoded_image_size(data[:2] + comment + data[2:]) == (4, 6)


@pytest.mark.parametrize("kind", [".png", ".jpg"])
def test_a_beginning_alone_has_a_size_or_none_but_never_fails(kind: str) -> None:
    data = cv2.imencode(kind, np.zeros((4, 6, 3), np.uint8))[1].tobytes()

    assert {encoded_image_size(data[:count]) for count in range(len(data))} == {None, (4, 6)}


@given(st.binary(), st.sampled_from([b"", b"\x89PNG\r\n\x1a\n", b"\xff\xd8", b"\xff\xd8\xff"]))
def test_garbage_never_fails(garbage: bytes, start: bytes) -> None:
    encoded_image_size(start + garbage)


def test_other_formats_have_no_size_here() -> None:
    data = cv2.imencode(".bmp", np.zeros((4, 6, 3), np.uint8))[1].tobytes()

    assert encoded_image_size(data) is None
