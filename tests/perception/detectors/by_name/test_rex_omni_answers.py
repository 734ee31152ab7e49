import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from poil_drake.perception.detectors.by_name.rex_omni import parse_answer as dut

SIZE = (999, 1998)  # One bin is one pixel high and two pixels wide.
HEAD = "<|object_ref_start|>handle<|object_ref_end|>"
FIRST = [70, 120, 420, 640]


@pytest.mark.parametrize(
    "answer",
    [
        f"{HEAD}<|box_start|><35><120><210><640><|box_end|><|im_end|>",
        f"{HEAD}<|box_start|><35><120><210><640>",  # Cut off after a box,
        f"{HEAD}<|box_start|><35><120><210><640>,<646><0><9",  # and in the next one.
        f"{HEAD}<|box_start|> <35> <120>\n<210> <640> , <|box_end|>",
        "the mug's <|box_start|><210><640><35><120><|box_end|>",  # Corners exchanged.
        f"{HEAD}<|box_start|><35><120><210><640>,<35><120><210><640><|box_end|>",
        f"{HEAD}<|box_start|><5><5><5><90>,<35><120><210><640><|box_end|>",  # One without area.
        f"{HEAD}<|box_start|><1><2>,<1><2><3><4><5><6>,<35><120><210><640><|box_end|>",
        f"{HEAD}<|box_start|><35><120><210><1000>,<35><120><210><640><|box_end|>",
        f"{HEAD}<|box_start|>None<|box_end|>, {HEAD}<|box_start|><35><120><210><640><|box_end|>",
    ],
)
def test_one_box_is_read_from_a_sound_or_damaged_answer(answer: str) -> None:
    np.testing.assert_allclose(dut(answer, SIZE).corners, [FIRST])


def test_several_boxes_are_read() -> None:
    answer = (
        f"{HEAD}<|box_start|><35><120><210><640>,<646><0><999><940><|box_end|>, "
        f"{HEAD}<|box_start|><0><0><1><1><|box_end|>"
    )

    corners = dut(answer, SIZE).corners

    np.testing.assert_allclose(corners, [FIRST, [1292, 0, 1998, 940], [0, 0, 2, 1]])


@pytest.mark.parametrize(
    "answer", ["", f"{HEAD}<|box_start|>None<|box_end|>", "I see <35><120><210><640>.", HEAD]
)
def test_no_box_is_read_where_there_is_none(answer: str) -> None:
    assert len(dut(answer, SIZE).corners) == 0


tokens = ["<|box_start|>", "<|box_end|>", ",", "None", "<7>", "<999>", "<12345>", HEAD, "x", "<|"]


@given(st.lists(st.sampled_from(tokens)))
def test_any_answer_is_read_without_an_error(parts: list[str]) -> None:
    assert np.all(dut("".join(parts), SIZE).corners <= [1998, 999, 1998, 999])
