from dataclasses import replace

import cv2
import numpy as np
from small_frames import make_frame

from poil_drake.recording.demonstration.demonstration import Demonstration
from poil_drake.reports.contact_sheet import contact_sheet


def test_the_picture_shows_the_cameras_over_time(tmp_path):
    demonstration = Demonstration([make_frame(i) for i in range(10)], {"scenario": "HangMug"})
    path = tmp_path / "out" / "sheet.png"

    contact_sheet(demonstration, path)

    picture = cv2.imread(str(path))
    # Eight tiles of 240 px and two cameras' colour and depth of 180 px, with text around them.
    assert picture.shape[1] > 8 * 240
    assert picture.shape[0] > 4 * 180
    # Only the last column has the colour of frame 9.
    blue, green, red = (int(c) for c in make_frame(9).images[0].rgb[12, 16][::-1])
    near = np.abs(picture.astype(int) - [blue, green, red]).max(axis=-1) <= 3
    assert near[:, picture.shape[1] // 2 :].any()
    assert not near[:, : picture.shape[1] // 2].any()


def test_only_the_frames_shown_are_decoded(tmp_path):
    decoded = set()

    class Frames(list):
        def __getitem__(self, index):
            decoded.add(index)
            return super().__getitem__(index)

    demonstration = Demonstration(Frames([make_frame(i) for i in range(15)]))

    contact_sheet(demonstration, tmp_path / "a.png")

    assert decoded == {0, 2, 4, 6, 8, 10, 12, 14}


def test_short_demonstrations_and_empty_depth_are_drawn(tmp_path):
    frames = []
    for i in range(2):
        frame = make_frame(i, names=("top",))
        blind = replace(frame.images[0], depth=np.zeros_like(frame.images[0].depth))
        frames.append(replace(frame, images=(blind,)))

    contact_sheet(Demonstration(frames), tmp_path / "a.png")

    assert (tmp_path / "a.png").exists()
