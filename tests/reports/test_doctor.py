import pytest

from poil_drake.reports import doctor


@pytest.mark.render
def test_a_machine_that_runs_the_tests_passes_except_for_the_network() -> None:
    findings = {finding.name: finding for finding in doctor.Examine()}
    assert {name for name, finding in findings.items() if not finding.ok} <= {"lcm"}
    assert "drew 64 x 48 pixels" in findings["rendering"].found


def test_an_error_is_a_finding_and_not_an_exception(monkeypatch: pytest.MonkeyPatch) -> None:
    def no_driver() -> str:
        raise RuntimeError("no EGL\nlong trace")

    monkeypatch.setattr(doctor, "_rendering", no_driver)
    findings = {finding.name: finding for finding in doctor.Examine()}
    assert not findings["rendering"].ok
    assert findings["rendering"].found == "no EGL"
    assert "libegl1" in findings["rendering"].remedy
