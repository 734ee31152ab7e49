"""Typed errors. Each says what is wrong and what to do about it."""

from functools import partial


class PoilError(Exception):
    """Base of every error that poil_drake raises on purpose.

    Args:
        problem: What is wrong: the thing, the value, and what was expected.
        remedy: What the user can do about it.
    """

    def __init__(self, problem: str, *, remedy: str):
        self.problem = problem
        self.remedy = remedy
        super().__init__(f"{problem} {remedy}")

    def __reduce__(self) -> tuple:
        """Pickles `problem` and `remedy`, so that an error can be sent to another process."""
        return partial(type(self), remedy=self.remedy), (self.problem,)


class InvalidValueError(PoilError, ValueError):
    """A value has the wrong shape, type or range."""


class ScenarioError(PoilError):
    """A scenario file is missing, or has a wrong key or value."""


class DemonstrationError(PoilError):
    """A demonstration file is missing, damaged or incomplete."""


class RunLogError(PoilError):
    """The log of a run is missing or damaged, or lacks data that a replay needs."""


class DetectionError(PoilError):
    """An object or part could not be found in the images."""


class LabelError(PoilError):
    """A file of labels made by hand is missing, damaged, or belongs to other images."""


class TransferError(PoilError):
    """The demonstrated motion could not be transferred to the target object."""


class TrackingError(PoilError):
    """The tracker cannot start, or has lost the object."""


class NoFeasibleGraspError(PoilError):
    """No grasp candidate passed the feasibility checks."""


class PlanningError(PoilError):
    """No collision-free approach to the grasp was found."""


class CaptureError(PoilError):
    """A camera cannot be opened, is disconnected, or delivers unusable images."""


class NoImageError(CaptureError):
    """A camera that is open delivers an unusable image, or has no more images."""


class CalibrationError(PoilError):
    """Views of a calibration board are unusable, or do not determine the cameras' poses."""


class NoMoreImagesError(NoImageError):
    """A recording that stands in for a camera has ended."""


class StationError(PoilError):
    """The simulation or hardware station cannot be built or has failed."""


class MissingDependencyError(PoilError, ImportError):
    """An optional library, a system library or a model's weights are missing."""
