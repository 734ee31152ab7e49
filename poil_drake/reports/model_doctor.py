"""Says which learned models this machine has, and how to get the others."""

import importlib.metadata
import sys

from poil_drake.errors import MissingDependencyError
from poil_drake.perception.detectors.by_name.config import GroundingDino, RexOmni, Sam3
from poil_drake.perception.segmenters.config import Sam2
from poil_drake.perception.trackers.learned.config import CoTracker3Config, MvTrackerConfig
from poil_drake.perception.trackers.learned.environment import check_environment
from poil_drake.reports.finding import Finding

_MODELS = (GroundingDino(), RexOmni(), Sam3(), Sam2())


def model_findings() -> list[Finding]:
    """Returns a finding for transformers and for each model's default weights.

    All are optional, so a missing one is no failure; what is found is the command that gets it.
    """
    try:
        version = importlib.metadata.version("transformers")
    except importlib.metadata.PackageNotFoundError:
        install = f"{sys.executable} -m pip install 'poil_drake[vision]'"
        text = f"not installed; only for detection by name, or masks by SAM 2: {install}"
        return [Finding("transformers", True, text, install)]
    findings = [Finding("transformers", True, version, "")]
    for model in _MODELS:
        try:
            found = f"weights in {model.folder()}"
        except MissingDependencyError as error:
            found = f"optional weights, not found. {error.remedy}"
        findings.append(Finding(type(model).__name__, True, found, ""))
    return findings


def tracker_findings() -> list[Finding]:
    """Returns a finding for each learned tracker: how to install it.

    Where it is installed is up to a scenario, so whether it is stays unknown here.
    """
    findings = []
    for tracker in (MvTrackerConfig(), CoTracker3Config()):
        try:
            found = check_environment(tracker)
        except MissingDependencyError as error:
            found = f"optional, in an environment of its own. {error.remedy}"
        findings.append(Finding(tracker.name, True, found, ""))
    return findings
