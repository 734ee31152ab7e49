import pytest

from poil_drake.diagrams.run.task_success import HangingJudge

ROD, TIP, STAND = "rack::rod::bar", "rack::rod::tip", "rack::stand::post"
TABLE, FINGER = "table::table::top", "panda::panda_leftfinger::pad"
OTHER_LINK_GEOMETRY, OTHER_MODEL = "rack::rod::base", "rack_of_the_neighbour::rod::bar"


def judge(*observations: tuple[float, set[str]]) -> HangingJudge:
    dut = HangingJudge(fixture="rack", holder=frozenset({ROD, TIP}))
    for time, touched in observations:
        dut.observe(time, frozenset(touched))
    return dut


@pytest.mark.parametrize(
    ("observations", "hanging_time"),
    [
        pytest.param([(0.0, {FINGER, ROD}), (0.5, {ROD}), (2.5, {ROD})], 2.0, id="let go"),
        pytest.param([(0.0, {STAND}), (3.0, {STAND})], 0.0, id="stands on the base"),
        pytest.param([(0.0, {ROD}), (1.0, {ROD, STAND}), (2.0, {ROD})], 2.0, id="leans"),
        pytest.param([(0.0, {ROD}), (0.05, set()), (0.1, {ROD})], 0.1, id="swings"),
        pytest.param([(0.0, {ROD}), (0.05, set()), (0.2, set())], 0.0, id="falls"),
        pytest.param([(0.0, {ROD}), (0.5, {ROD, TABLE}), (0.75, {ROD}), (1.0, {ROD})], 0.25),
        pytest.param([(0.0, set()), (5.0, set())], 0.0, id="never touched the fixture"),
        pytest.param([(0.0, {OTHER_LINK_GEOMETRY}), (3.0, {OTHER_LINK_GEOMETRY})], 0.0),
        pytest.param([(0.0, {ROD}), (1.0, {ROD, OTHER_MODEL})], 0.0, id="model with same prefix"),
    ],
)
def test_hanging_time_since_nothing_but_the_fixture_is_touched(
    observations: list[tuple[float, set[str]]], hanging_time: float
) -> None:
    assert judge(*observations).hanging_time(observations[-1][0]) == hanging_time


def test_each_touched_link_is_named_once() -> None:
    assert judge((0.0, {ROD, TIP, TABLE})).touched_links == {"rack::rod", "table::table"}
