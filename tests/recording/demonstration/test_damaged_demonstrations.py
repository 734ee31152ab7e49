"""Loading a damaged file either works or raises a DemonstrationError."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from small_frames import make_frame

from poil_drake.errors import DemonstrationError
from poil_drake.recording.demonstration.demonstration import load_demonstration
from poil_drake.recording.demonstration.writer import DemonstrationWriter
from poil_drake.recording.mcap.message_encoder import ColorEncoding

COUNT = 4


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """A small, whole recording, and a place for its damaged copies."""
    directory = tmp_path_factory.mktemp("damaged")
    with DemonstrationWriter(directory / "whole.mcap", ["top"], {"seed": "1"}) as writer:
        for i in range(COUNT):
            writer.write(make_frame(i, ("top",)))
    return (directory / "whole.mcap").read_bytes(), directory / "damaged.mcap"


def load_all(path):
    return [frame.images[0] for frame in load_demonstration(path).frames]


@settings(max_examples=150)
@given(fraction=st.floats(0.0, 1.0, exclude_max=True))
def test_a_cut_off_file_is_refused(recording, fraction):
    whole, path = recording
    path.write_bytes(whole[: int(fraction * len(whole))])

    with pytest.raises(DemonstrationError, match=r"damaged\.mcap is (empty|cut off.*mcap recover)"):
        load_all(path)


@pytest.fixture(scope="module")
def live_recording(tmp_path_factory):
    """A live recording, and a place for its first part."""
    directory = tmp_path_factory.mktemp("live")
    path = directory / "live.mcap"
    with DemonstrationWriter(path, ["top"], {}, live=True, color=ColorEncoding(format="raw")) as w:
        for i in range(40):
            w.write(make_frame(i, ("top",)))
    return path.read_bytes(), directory / "damaged.mcap", load_all(path)


@settings(max_examples=60)
@given(fraction=st.floats(0.0, 1.0, exclude_max=True))
def test_what_is_left_of_a_live_recording_is_loaded(live_recording, fraction):
    whole, path, images = live_recording
    path.write_bytes(whole[: int(fraction * len(whole))])

    try:
        left = load_all(path)
    except DemonstrationError:
        left = []
    # A chunk holds 64 kB before compression, which is 16 images.
    assert len(left) >= 40 * fraction - 20
    for found, wanted in zip(left, images, strict=False):
        np.testing.assert_array_equal(found.rgb, wanted.rgb)
        np.testing.assert_array_equal(found.depth, wanted.depth)


@settings(max_examples=150)
@given(data=st.data())
def test_a_damaged_byte_is_detected_or_harmless(recording, data):
    whole, path = recording
    at = data.draw(st.integers(0, len(whole) - 1))
    change = data.draw(st.integers(1, 255))
    path.write_bytes(whole[:at] + bytes([whole[at] ^ change]) + whole[at + 1 :])

    try:
        images = load_all(path)
    except DemonstrationError:
        return
    path.write_bytes(whole)
    for damaged, wanted in zip(images, load_all(path), strict=True):
        np.testing.assert_array_equal(damaged.rgb, wanted.rgb)
        np.testing.assert_array_equal(damaged.depth, wanted.depth)


@settings(max_examples=100)
@given(content=st.binary(max_size=300), with_magic=st.booleans())
def test_any_other_bytes_are_refused(recording, content, with_magic):
    whole, path = recording
    path.write_bytes(whole[:8] * with_magic + content)

    with pytest.raises(DemonstrationError, match=r"damaged\.mcap"):
        load_all(path)


@pytest.mark.parametrize(
    ("content", "words"),
    [(b"", "is empty"), (b"\x89MCA", "is cut off"), (b"ply\nformat ascii", "is not an MCAP file")],
)
def test_errors_distinguish_other_files_from_damaged_ones(recording, content, words):
    _, path = recording
    path.write_bytes(content)

    with pytest.raises(DemonstrationError, match=words):
        load_demonstration(path)


def test_errors_name_a_missing_file_and_a_folder(tmp_path):
    with pytest.raises(DemonstrationError, match=r"none\.mcap cannot be read: No such file"):
        load_demonstration(tmp_path / "none.mcap")
    with pytest.raises(DemonstrationError, match="cannot be read"):
        load_demonstration(tmp_path)
