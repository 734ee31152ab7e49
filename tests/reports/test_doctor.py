import sys

import pytest

from poil_drake.reports import doctor


def test_an_error_is_a_finding_and_not_an_exception(monkeypatch: pytest.MonkeyPatch) -> None:
    def no_driver() -> str:
        raise RuntimeError("no EGL\nlong trace")

    monkeypatch.setattr(doctor, "_rendering", no_driver)
    findings = {finding.name: finding for finding in doctor.Examine()}
    assert not findings["rendering"].ok
    assert findings["rendering"].found == "no EGL"
    assert findings["rendering"].remedy.startswith("sudo apt-get install libegl1 ")


@pytest.mark.parametrize(
    ("problem", "remedy"),
    [
        ("No module named 'open3d'", f"{sys.executable} -m pip install open3d"),
        (
            "libusb-1.0.so.0: cannot open shared object file: No such file or directory",
            "sudo apt-get install libusb-1.0-0",
        ),
    ],
)
def test_the_remedy_is_the_command_that_installs_what_is_missing(
    monkeypatch: pytest.MonkeyPatch, problem: str, remedy: str
) -> None:
    def fail(distribution: str, module: str) -> str:
        raise ImportError(problem)

    monkeypatch.setattr(doctor, "_version", fail)
    monkeypatch.setattr(doctor, "_rendering", lambda: "")
    findings = {finding.name: finding for finding in doctor.Examine()}
    assert findings["open3d"].remedy == remedy
