"""Whatever headers say, a recording loads with sensible contents, or is refused with a reason."""

import numpy as np
from hypothesis import HealthCheck, event, given, settings
from hypothesis import strategies as st

from poil_drake.errors import DemonstrationError

ENCODINGS = ["16UC1", "mono16", "32FC1", "mono8", "rgb8", "bgr8", "32SC1", ""]
FRAMES = [
    "left_lens",
    "/left_lens",
    "right_lens",
    "world",
    "",
    "nowhere",
    "x_aligned_depth_to_color",
]
SECOND = 10**9
STAMPS = st.one_of(
    st.sampled_from([0, 1, SECOND, 1_760_000_000 * SECOND, 2**62, 2**63 - 1, -SECOND]),
    st.integers(0, 2 * SECOND),
)
NUMBERS = st.one_of(
    st.sampled_from([0.0, 1.0, -1.0, 1e-300, 1e300, float("nan"), float("inf")]),
    st.floats(-100.0, 100.0),
)
KINDS = [
    "clock",
    "stamps",
    "times",
    "missing",
    "frames",
    "encodings",
    "sizes",
    "poses",
    "lens",
    "transforms",
]


@settings(
    max_examples=1000, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(data=st.data(), kinds=st.sets(st.sampled_from(KINDS), max_size=2))
def test_an_odd_recording_loads_or_is_refused(foreign, data, kinds):
    def sometimes(kind, strategy):
        """Draws a value for one in four of the things that `kind` changes; otherwise None."""
        return data.draw(strategy) if kind in kinds and data.draw(st.integers(0, 3)) == 0 else None

    foreign.__init__(foreign.path)
    clock = sometimes("clock", st.lists(st.floats(0.0, 1.0) | st.floats(0.0, 1e9), max_size=5))
    for topic in list(foreign.times):
        foreign.times[topic] = foreign.times[topic] if clock is None else clock
        if (times := sometimes("times", st.lists(st.floats(0.0, 10.0), max_size=6))) is not None:
            foreign.times[topic] = times
        if sometimes("missing", st.just(True)) is not None:
            del foreign.times[topic]

    def stamped(message):
        if (stamp := sometimes("stamps", STAMPS)) is not None:
            message.timestamp.seconds, message.timestamp.nanos = divmod(stamp, SECOND)
        return message

    def make(usual):
        def message(i, time, frame):
            made = usual(i, time, frame)
            if (name := sometimes("frames", st.sampled_from(FRAMES))) is not None:
                made.frame_id = name
            if (encoding := sometimes("encodings", st.sampled_from(ENCODINGS))) is not None:
                made.encoding = encoding
            if (
                size := sometimes("sizes", st.sampled_from([(12, 16), (1, 1), (0, 0)]))
            ) is not None:
                made.height, made.width = size
                made.step = data.draw(st.sampled_from([made.step, 0, 1, 2**32 - 1]))
            return stamped(made)

        return message

    foreign.color, foreign.depth = make(foreign.color), make(foreign.depth)
    for _ in range(data.draw(st.integers(0, 3)) if "transforms" in kinds else 0):
        ends = data.draw(st.tuples(st.sampled_from(FRAMES), st.sampled_from(FRAMES)))
        foreign.transforms.append(foreign.transform(*ends, (0.0, 0.1, 0.6)))
    for message in foreign.transforms:
        for part in (message.translation, message.rotation):
            if (number := sometimes("poses", NUMBERS)) is not None:
                part.x = number
        stamped(message)
    calibration = foreign.calibrations["left"]
    for i in range(9):
        if (number := sometimes("lens", NUMBERS)) is not None:
            calibration.K[i] = number
    calibration.D.extend(sometimes("lens", st.lists(NUMBERS, max_size=6)) or [])
    calibration.distortion_model = "plumb_bob"

    def extra(writer):
        if sometimes("lens", st.just(True)):
            topic = "/camera/right/depth_calibration"
            writer.write_message(topic, calibration, log_time=0, publish_time=0)

    refusal, frames = "", []
    try:
        dut = foreign.load(extra)
        frames = list(dut.frames)
    except DemonstrationError as error:
        refusal = str(error)
    if refusal:
        event(f"refused: {refusal.replace(str(foreign.path), '')[:50]}")
        assert str(foreign.path) in refusal
        return

    event(f"loaded: {', '.join(sorted(kinds)) or 'as usual'}")
    assert np.all(np.diff(dut.stamps) > 0.0)
    assert dut.duration < 60.0
    for frame in frames:
        for camera, image in zip(frame.cameras, frame.images, strict=True):
            assert np.all(np.isfinite(camera.X_WC))
            assert np.all(np.isfinite(image.depth) & (image.depth >= 0.0))
