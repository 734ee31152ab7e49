import numpy as np
import pytest

from poil_drake.recording.demonstration.relabelling import relabelled

# A demonstration has no robot, so the mug's numbers differ from those in a run.
RECORDED = {"table": (1,), "mug": (2, 3), "mug/handle": (2,), "rack": (4,)}
WANTED = {"table": (1,), "rack": (2,), "panda": (3,), "mug": (4, 5, 6), "mug/handle": (5,)}
WANTED |= {"mug/rim": (4,)}


@pytest.mark.parametrize(
    ("number", "expected"),
    [(1, 1), (2, 5), (3, 6), (4, 2), (0, 0), (7, 0), (32766, 0)],
    ids=["table", "handle", "rest of the mug", "rack", "nothing", "unnamed", "empty"],
)
def test_labels_are_translated_by_name(number: int, expected: int) -> None:
    label = np.full((2, 3), number, np.int16)

    dut = relabelled(label, RECORDED, WANTED)

    np.testing.assert_array_equal(dut, np.full((2, 3), expected, np.int16))


def test_a_name_that_the_scenario_lacks_becomes_nothing() -> None:
    label = np.array([[1, 2, 4]], np.int16)

    assert relabelled(label, RECORDED, {"rack": (9,)}).tolist() == [[0, 0, 9]]


def test_labels_without_names_are_kept() -> None:
    label = np.array([[1, 2, 4]], np.int16)

    np.testing.assert_array_equal(relabelled(label, {}, WANTED), label)
