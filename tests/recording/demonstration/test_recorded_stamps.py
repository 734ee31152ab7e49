"""Header stamps that are not filled in, jump, repeat or are of different clocks."""

import numpy as np
import pytest

from poil_drake.errors import DemonstrationError

START = 1_760_000_000.0
TOPICS = [f"/camera/{name}/{kind}" for name in ("left", "right") for kind in ("image", "depth")]


def restamp(foreign, stamp, *, count=20, latency=0.02):
    """Gives message i of topic t, logged `latency` after START + i / 8, the stamp(t, i) [s]."""
    number = dict.fromkeys(TOPICS, -1)
    foreign.log_offset = latency
    foreign.times = {topic: [START + i / 8 for i in range(count)] for topic in TOPICS}

    def make(kind):
        def message(i, time, frame):
            topic = f"/camera/{frame.removesuffix('_lens')}/{kind}"
            number[topic] += 1
            image = foreign.image(i, stamp=time)
            pixels = image.rgb if kind == "image" else np.rint(1000 * image.depth).astype("<u2")
            encoding = "rgb8" if kind == "image" else "16UC1"
            return foreign.raw(encoding, pixels, stamp(topic, number[topic]), frame)

        return message

    foreign.color, foreign.depth = make("image"), make("depth")


def true(i):
    return START + i / 8


@pytest.mark.parametrize("topics", [TOPICS, TOPICS[1:2]], ids=["all topics", "one topic"])
def test_without_stamps_all_images_get_the_times_of_logging(foreign, topics):
    restamp(foreign, lambda topic, i: 0.0 if topic in topics else true(i))

    dut = foreign.load()

    np.testing.assert_allclose(dut.stamps - START, 0.02 + np.arange(20) / 8, atol=1e-6)


@pytest.mark.parametrize(
    ("stamp", "words"),
    [
        pytest.param(
            lambda topic, i: 0.0 if i < 2 else true(i),
            ["/camera/left/image jump ahead by 1760000000.250 s after 0.0 s; 2 of them are 0"],
            id="first",
        ),
        pytest.param(
            lambda topic, i: 0.0 if i == 7 and topic == TOPICS[3] else true(i),
            ["/camera/right/depth jump back by 1760000000.750 s after", "; 1 of them are 0"],
            id="one in between",
        ),
        pytest.param(
            lambda topic, i: true(i) - (3600.0 if i > 5 else 0.0),
            ["/camera/left/image jump back by 3599.875 s after 1760000000.625 s"],
            id="back",
        ),
        pytest.param(
            lambda topic, i: true(i) - (0.8 if i > 15 and topic == TOPICS[1] else 0.0),
            ["/camera/left/depth jump back by 0.675 s after 1760000001.875 s"],
            id="one topic back",
        ),
        pytest.param(
            lambda topic, i: true(i) + (40.0 if i > 5 else 0.0),
            ["/camera/left/image jump ahead by 40.125 s after 1760000000.625 s"],
            id="ahead",
        ),
        pytest.param(
            lambda topic, i: true(i) + (1.0 if i > 8 else 0.0),
            ["jump ahead by 1.000 s after 1760000001.0 s"],
            id="all topics ahead",
        ),
        pytest.param(
            lambda topic, i: 1e-6 * true(i),
            ["/camera/left/image are 1.25e-07 s apart, the first is 1760.0 s", "their unit"],
            id="in microseconds",
        ),
        pytest.param(
            lambda topic, i: true(i) + (0.35 if i > 8 and topic == TOPICS[2] else 0.0),
            ["clocks", "/camera/right/image", "a gap of 0.35 s"],
            id="one topic ahead",
        ),
        pytest.param(
            lambda topic, i: true(i) + (0.45 if "right" in topic else 0.0),
            ["clocks", "/camera/right/", "/camera/left/", "a gap of 0.45 s"],
            id="two clocks",
        ),
        pytest.param(
            lambda topic, i: true(i) - (START if "right" in topic else 0.0),
            ["clocks", "/camera/right/", "a gap of 17600"],
            id="time since boot",
        ),
        pytest.param(
            lambda topic, i: START,
            ["/camera/left/image repeat", "20 messages have 1 different stamps, the first is 1760"],
            id="equal",
        ),
        pytest.param(
            lambda topic, i: float(int(true(i))),
            ["/camera/left/image repeat", "20 messages have 3 different stamps"],
            id="without nanoseconds",
        ),
    ],
)
def test_wrong_stamps_are_named(foreign, stamp, words):
    restamp(foreign, stamp)

    with pytest.raises(DemonstrationError) as caught:
        foreign.load()

    for word in (str(foreign.path), *words):
        assert word in str(caught.value)
    assert "of logging" in caught.value.remedy


def test_swapped_and_repeated_messages_cost_at_most_a_frame(foreign):
    def stamp(topic, i):
        swapped = {5: 6, 6: 5}.get(i, i) if topic == TOPICS[1] else i
        return true(swapped - (swapped == 12 and topic == TOPICS[2]))

    restamp(foreign, stamp)

    dut = foreign.load()

    np.testing.assert_allclose(dut.stamps - START, np.delete(np.arange(20) / 8, 12), atol=1e-6)


def test_a_busy_recorder_that_logs_late_is_no_jump(foreign):
    # Messages 5 to 12 of all topics are logged together, a second late.
    restamp(foreign, lambda topic, i: true(i))
    late = {topic: [true(12) if 5 <= i <= 12 else true(i) for i in range(20)] for topic in TOPICS}
    foreign.times = late

    assert len(foreign.load().frames) == 20


def test_depth_may_take_long_to_compute(foreign):
    restamp(foreign, lambda topic, i: true(i))
    late = [time + 0.6 for time in foreign.times[TOPICS[1]]]
    foreign.times[TOPICS[1]] = foreign.times[TOPICS[3]] = late

    assert len(foreign.load().frames) == 20


@pytest.mark.parametrize("speed", [0.5, 0.9, 1.02])
def test_a_simulation_may_be_slower_or_faster_than_the_recorder(foreign, speed):
    restamp(foreign, lambda topic, i: 100.0 + i / 8 * speed + (0.2 if topic == TOPICS[0] else 0.0))

    assert len(foreign.load().frames) >= 16


def test_log_times_of_a_conversion_do_not_count(foreign):
    # A converter logged the messages one after the other within 40 ms.
    restamp(foreign, lambda topic, i: true(i) - (0.1 if "right" in topic else 0.0))
    foreign.times = {topic: [5.0 + i / 500 for i in range(20)] for topic in TOPICS}

    assert len(foreign.load().frames) == 19


@pytest.mark.parametrize("seconds", [-5, 2**33, 2**62])
def test_an_impossible_stamp_is_refused(foreign, seconds):
    color = foreign.color

    def impossible(i, time, frame):
        message = color(i, time, frame)
        message.timestamp.seconds = seconds
        return message

    foreign.color = impossible

    with pytest.raises(DemonstrationError, match=f"/camera/left/image: .*{seconds} s and"):
        foreign.load()


def test_a_camera_on_a_moving_arm_is_between_its_transforms(foreign):
    # The camera moves along x at 0.2 m/s; /tf is recorded at 2 Hz.
    restamp(foreign, lambda topic, i: true(i))
    foreign.transforms = [
        foreign.transform("world", f"{name}_lens", (0.2 * i / 2, 0.0, 0.6))
        for name in ("left", "right")
        for i in range(6)
    ]
    for i, message in enumerate(foreign.transforms):
        message.timestamp.FromNanoseconds(round((START + i % 6 / 2) * 1e9))

    dut = foreign.load()

    for frame in dut.frames:
        wanted = 0.2 * (frame.stamp - START)
        assert frame.cameras[0].X_WC[0, 3] == pytest.approx(wanted, abs=1e-6)


def moving(foreign, stamps):
    """Makes the right camera move, with transforms at these times [s after START]."""
    foreign.transforms = foreign.transforms[:1]
    for i, stamp in enumerate(stamps):
        message = foreign.transform("world", "right_lens", (0.01 * i, 0.0, 0.6))
        message.timestamp.FromNanoseconds(round((START + stamp) * 1e9))
        foreign.transforms.append(message)


@pytest.mark.parametrize(
    ("stamps", "words"),
    [
        pytest.param([0.0, 0.3, 2.0], ["no transform between", "a gap of 1.70 s"], id="a gap"),
        pytest.param([0.0, 0.5, 1.0], ["reach from", "a gap of 1.38 s"], id="they stop"),
        pytest.param([900.0, 901.0], ["reach from", "a gap of 900.00 s"], id="another clock"),
    ],
)
def test_stale_transforms_are_named(foreign, stamps, words):
    restamp(foreign, lambda topic, i: true(i))
    moving(foreign, stamps)

    with pytest.raises(DemonstrationError) as caught:
        foreign.load()

    for word in (str(foreign.path), "frame 'right_lens'", "176000", *words):
        assert word in str(caught.value)


def test_a_moving_camera_without_transforms_at_an_end_loses_those_frames(foreign):
    restamp(foreign, lambda topic, i: true(i))
    moving(foreign, [1.0, 1.5, 2.0])

    stamps = foreign.load().stamps

    np.testing.assert_allclose(stamps - START, np.arange(8, 17) / 8, atol=1e-6)
