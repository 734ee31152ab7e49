import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from poil_drake.recording.demonstration.frame_grouping import group_by_stamp, nearest


def test_simultaneous_streams_are_paired_one_to_one():
    stamps = np.array([0, 10, 20, 30])

    np.testing.assert_array_equal(
        group_by_stamp([stamps, stamps]), [[0, 0], [1, 1], [2, 2], [3, 3]]
    )


def test_the_slowest_stream_sets_the_pace():
    slow, fast = np.array([0, 30, 60]), np.arange(0, 61, 10)

    np.testing.assert_array_equal(group_by_stamp([fast, slow]), [[0, 0], [3, 1], [6, 2]])


def test_where_a_stream_has_a_gap_the_instant_is_left_out():
    # Both have a median period of 10, so at most 5 is near enough; 20 and 26 are 6 apart.
    a, b = np.array([0, 10, 20, 30, 40]), np.array([4, 14, 26, 34, 44])

    np.testing.assert_array_equal(group_by_stamp([a, b]), [[0, 0], [1, 1], [3, 3], [4, 4]])


def test_streams_half_a_period_apart_are_paired_alike():
    a = np.arange(0, 50, 10)

    np.testing.assert_array_equal(group_by_stamp([a, a + 5]), [[i, i] for i in range(5)])


def test_no_message_is_used_twice():
    # 14 is the nearest to both 10 and 18. Both streams have a median period of 10.
    a, b = np.array([0, 10, 18, 30, 40, 50]), np.array([0, 14, 30, 40, 50, 60])

    np.testing.assert_array_equal(group_by_stamp([a, b]), [[0, 0], [1, 1], [3, 2], [4, 3], [5, 4]])


def test_a_repeated_stamp_gives_one_frame():
    a, b = np.array([0, 10, 10, 20]), np.array([0, 10, 20])

    np.testing.assert_array_equal(group_by_stamp([a, b]), [[0, 0], [1, 1], [3, 2]])


@given(
    stamps=st.lists(st.integers(0, 1000), min_size=2, max_size=20),
    at=st.lists(st.integers(-100, 1100), min_size=1, max_size=20),
)
def test_nearest_agrees_with_a_search_of_all(stamps, at):
    stamps_, at_ = np.sort(stamps), np.array(at)

    got = nearest(stamps_, at_)

    distances = np.abs(stamps_[:, None] - at_)
    np.testing.assert_array_equal(distances[got, np.arange(len(at_))], distances.min(axis=0))
