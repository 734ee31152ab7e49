import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from poil_drake.recording.demonstration.frame_grouping import group_by_stamp, nearest

REGULAR = [0, 10, 20, 30]


@pytest.mark.parametrize(
    ("a", "b", "rows"),
    [
        pytest.param(REGULAR, REGULAR, [[0, 0], [1, 1], [2, 2], [3, 3]], id="simultaneous"),
        pytest.param(
            [*range(0, 61, 10)], [0, 30, 60], [[0, 0], [3, 1], [6, 2]], id="slow and fast"
        ),
        # Both have a median period of 10, so at most 5 is near enough; 20 and 26 are 6 apart.
        pytest.param(
            [*REGULAR, 40], [4, 14, 26, 34, 44], [[0, 0], [1, 1], [3, 3], [4, 4]], id="gap"
        ),
        pytest.param(
            REGULAR, [5, 15, 25, 35], [[0, 0], [1, 1], [2, 2], [3, 3]], id="half a period apart"
        ),
        # 14 is the nearest to both 10 and 18, and is used once. Both have a median period of 10.
        pytest.param(
            [0, 10, 18, 30, 40, 50],
            [0, 14, 30, 40, 50, 60],
            [[0, 0], [1, 1], [3, 2], [4, 3], [5, 4]],
            id="one message near two",
        ),
        pytest.param([0, 10, 10, 20], [0, 10, 20], [[0, 0], [1, 1], [3, 2]], id="repeated stamp"),
    ],
)
def test_messages_of_one_instant_are_grouped(a, b, rows):
    np.testing.assert_array_equal(group_by_stamp([np.array(a), np.array(b)]), rows)


@given(
    stamps=st.lists(st.integers(0, 1000), min_size=2, max_size=20),
    at=st.lists(st.integers(-100, 1100), min_size=1, max_size=20),
)
def test_nearest_agrees_with_a_search_of_all(stamps, at):
    stamps_, at_ = np.sort(stamps), np.array(at)

    got = nearest(stamps_, at_)

    distances = np.abs(stamps_[:, None] - at_)
    np.testing.assert_array_equal(distances[got, np.arange(len(at_))], distances.min(axis=0))
