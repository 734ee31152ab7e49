from poil_drake.diagrams.run.task_success import HangingJudge

ROD, STAND = "rack::rod::bar", "rack::stand::post"
TABLE, FINGER = "table::table::top", "panda::panda_leftfinger::pad"


def judge(*observations: tuple[float, set[str]]) -> HangingJudge:
    dut = HangingJudge(fixture="rack", holder=frozenset({ROD, "rack::rod::tip"}))
    for time, touched in observations:
        dut.observe(time, frozenset(touched))
    return dut


def test_counts_from_the_first_contact_with_nothing_but_the_fixture() -> None:
    dut = judge((0.0, {FINGER, ROD}), (0.5, {ROD}), (1.0, {ROD}), (2.5, {ROD}))
    assert dut.hanging_time(2.5) == 2.0


def test_standing_on_the_fixtures_base_is_no_hanging() -> None:
    assert judge((0.0, {STAND}), (3.0, {STAND})).hanging_time(3.0) == 0.0


def test_leaning_against_the_fixture_while_hanging_is_fine() -> None:
    dut = judge((0.0, {ROD}), (1.0, {ROD, STAND}), (2.0, {ROD}))
    assert dut.hanging_time(2.0) == 2.0


def test_a_swing_without_contact_does_not_break_the_spell() -> None:
    dut = judge((0.0, {ROD}), (0.05, set()), (0.1, {ROD}))
    assert dut.hanging_time(0.1) == 0.1


def test_a_fall_breaks_the_spell_before_the_landing() -> None:
    dut = judge((0.0, {ROD}), (0.05, set()), (0.2, set()))
    assert dut.hanging_time(0.2) == 0.0


def test_touching_the_table_breaks_the_spell() -> None:
    dut = judge((0.0, {ROD}), (0.5, {ROD, TABLE}), (0.75, {ROD}), (1.0, {ROD}))
    assert dut.hanging_time(1.0) == 0.25


def test_an_object_that_never_touched_the_fixture_does_not_hang() -> None:
    assert judge((0.0, set()), (5.0, set())).hanging_time(5.0) == 0.0


def test_another_geometry_of_the_same_link_is_no_holder() -> None:
    base = "rack::rod::base"
    assert judge((0.0, {base}), (3.0, {base})).hanging_time(3.0) == 0.0


def test_a_fixture_whose_name_begins_like_another_models_is_told_from_it() -> None:
    other = "rack_of_the_neighbour::rod::bar"
    assert judge((0.0, {ROD}), (1.0, {ROD, other})).hanging_time(1.0) == 0.0


def test_links_are_named_once() -> None:
    assert judge((0.0, {ROD, "rack::rod::tip", TABLE})).touched_links == {
        "rack::rod",
        "table::table",
    }
