"""Labels of one camera, and labels that come late."""

import numpy as np
import pytest

LABEL = np.zeros((24, 32), np.uint8)
LABEL[4:9, 5:20] = 4


def labels(foreign, stamps, *, latency=0.0):
    """Writes label images of the cameras at their stamps [s], logged `latency` after capture."""
    foreign.metadata = {"label_ids": '{"mug": [4]}'}

    def extra(writer):
        for name, times in stamps.items():
            for time in times:
                message = foreign.raw("mono8", LABEL, time)
                log_time = round(1e9 * (time + latency))
                topic = f"/camera/{name}/label"
                writer.write_message(topic, message, log_time=log_time, publish_time=log_time)

    return extra


@pytest.mark.parametrize("camera", ["left", "right"])
def test_labels_of_one_camera(foreign, camera):
    frame = foreign.load(labels(foreign, {camera: [0.0]})).frames[0]

    found = dict(zip(["left", "right"], frame.images, strict=True))
    np.testing.assert_array_equal(found.pop(camera).label, LABEL)
    assert [image.label for image in found.values()] == [None]
    assert frame.label_ids == {"mug": (4,)}


@pytest.mark.parametrize("late", [[0.4], [0.4, 0.525, 0.65], [0.95]])
def test_late_labels_count_for_the_first_frame(foreign, late):
    frames = foreign.load(labels(foreign, {"left": late, "right": [0.0]})).frames

    assert all(image.label is not None for image in frames[0].images)
    assert all(image.label is None for image in frames[1].images)


@pytest.mark.parametrize("time", [1.2, 30.0])
def test_much_later_labels_do_not_count(foreign, time):
    frames = foreign.load(labels(foreign, {"left": [time]})).frames

    assert all(image.label is None for frame in frames for image in frame.images)


def test_labels_without_stamps_count_from_their_logging(foreign):
    start = 1_760_000_000.0
    foreign.times = {topic: [start + t for t in times] for topic, times in foreign.times.items()}
    extra = labels(foreign, {"left": [0.0]}, latency=start + 0.3)

    frames = foreign.load(extra).frames

    assert frames[0].images[0].label is not None
