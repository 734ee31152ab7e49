import numpy as np
import pytest

from poil_drake.perception.images import RgbdImage
from poil_drake.recording.run_log.recorded_run import Series
from poil_drake.systems.cameras.recorded_cameras import RecordedCamera, RecordedCameras

H, W = 3, 4


class Reader:
    """Makes images whose pixels are their number."""

    def __init__(self, labelled=()):
        self.reads, self._labelled = [], labelled

    def __call__(self, index):
        self.reads.append(index)
        return RgbdImage(
            np.full((H, W, 3), index, np.uint8),
            np.full((H, W), 1.0 + index, np.float32),
            0.0,
            label=np.full((H, W), index, np.int16) if index in self._labelled else None,
        )


def make(reader=None, *, labels=False, times=((0.0, np.nan), (0.3, 0.25), (0.9, 0.75))):
    series = None if times is None else Series.of([(t, [s]) for t, s in times], 1)
    camera = RecordedCamera(
        name="left",
        shown_from=[0.25, 0.5],
        stamps=[0.125, 0.375],
        read=reader or Reader(),
        labels=labels,
        times=series,
    )
    return RecordedCameras(cameras=[camera])


def show(dut, port, time):
    context = dut.CreateDefaultContext()
    context.SetTime(time)
    value = dut.GetOutputPort(port).Eval(context)
    return value.data if hasattr(value, "data") and hasattr(value, "width") else value


@pytest.mark.parametrize(("time", "shown"), [(0.25, 0), (0.49, 0), (0.5, 1), (9.0, 1)])
def test_the_newest_image_is_shown(time, shown):
    dut = make()

    assert show(dut, "left.rgb_image", time)[0, 0].tolist() == [shown, shown, shown, 255]
    assert show(dut, "left.depth_image", time)[0, 0, 0] == 1.0 + shown


def test_before_the_first_image_there_is_none():
    dut = make(labels=True)

    for kind in ("rgb_image", "depth_image", "label_image"):
        assert show(dut, f"left.{kind}", 0.2).size == 0
    assert np.isnan(show(dut, "left.image_time", 0.2)[0])


def test_images_are_decoded_only_when_evaluated():
    reader = Reader()
    dut = make(reader)

    show(dut, "left.image_time", 0.6)

    assert reader.reads == []


@pytest.mark.parametrize(
    ("time", "captured"), [(0.26, 0.125), (0.3, 0.25), (0.49, 0.25), (0.5, 0.375), (0.9, 0.75)]
)
def test_the_time_is_that_of_the_newest_image_even_if_it_was_not_recorded(time, captured):
    assert show(make(), "left.image_time", time)[0] == captured


def test_the_time_of_images_without_a_delay_is_now():
    assert show(make(times=None), "left.image_time", 0.4375)[0] == 0.4375


def test_labels_are_shown_where_there_are_any():
    dut = make(Reader(labelled=[1]), labels=True)

    assert show(dut, "left.label_image", 0.25).size == 0
    assert show(dut, "left.label_image", 0.5)[0, 0, 0] == 1
    assert not make().HasOutputPort("left.label_image")
