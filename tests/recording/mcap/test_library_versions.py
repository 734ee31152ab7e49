from importlib.metadata import version

from poil_drake.recording.mcap.library_versions import library_versions, version_metadata


def test_versions_name_python_and_the_libraries() -> None:
    dut = library_versions()

    assert {"python", "drake", "poil-drake", "numpy"} <= dut.keys()
    assert dut["drake"] == version("drake")


def test_metadata_has_keys_that_need_no_quotes() -> None:
    dut = version_metadata()

    assert dut["poil_drake_version"] == version("poil-drake")
    assert all(key.isidentifier() for key in dut)
