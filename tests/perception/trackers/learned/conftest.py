"""Stand-ins for the learned trackers' repositories and weights; their environment is this one."""

import sys
from collections.abc import Callable
from pathlib import Path

import pytest
import torch


@pytest.fixture(scope="package")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], dict[str, str]]:
    """Returns a function from a stand-in's folder to the paths in its tracker's configuration."""

    def install(folder: str, prefix: str = "") -> dict[str, str]:
        weights = tmp_path_factory.mktemp("weights") / f"{folder}.pth"
        torch.save({f"{prefix}gain": torch.ones(1)}, weights)
        repository = Path(__file__).with_name(folder)
        return {
            "python": sys.executable,
            "repository": str(repository),
            "weights": str(weights),
            "device": "cpu",
        }

    return install
