from .control.field.point_set_bcsdm import BcsdmConfig as BcsdmConfig
from .control.reference.make_reference import make_reference as make_reference
from .control.reference.point_trajectory import PointTrajectory as PointTrajectory
from .diagrams.demonstration.camera_recorder import RecordFromCameras as RecordFromCameras
from .diagrams.demonstration.recorder import RecordDemonstration as RecordDemonstration
from .diagrams.loop.closed_loop import ClosedLoop as ClosedLoop
from .diagrams.loop.closed_loop import MakeClosedLoop as MakeClosedLoop
from .diagrams.replay.replay import Replay as Replay
from .diagrams.run.html_recording import HtmlRecording as HtmlRecording
from .diagrams.run.html_recording import MakeMeshcat as MakeMeshcat
from .diagrams.run.output_paths import OutputPaths as OutputPaths
from .diagrams.run.planning import PlanScenario as PlanScenario
from .diagrams.run.skill_run import ExecutePlan as ExecutePlan
from .diagrams.run.skill_run import RunSkill as RunSkill
from .diagrams.scenario.load import LoadScenario as LoadScenario
from .diagrams.scenario.load import default_scenario_file as default_scenario_file
from .diagrams.scenario.scenario import Scenario as Scenario
from .diagrams.station.station import CaptureFrame as CaptureFrame
from .diagrams.station.station import MakeStation as MakeStation
from .diagrams.station.station_base import Station as Station
from .errors import PoilError as PoilError
from .grasping.execution_plan import ExecutionPlan as ExecutionPlan
from .recording.demonstration.demonstration import LoadDemonstration as LoadDemonstration
from .systems.control.point_set_bcsdm import PointSetBcsdm as PointSetBcsdm
from .systems.control.safe_entry import SafeEntry as SafeEntry
from .systems.detection.part_detector import PartDetector as PartDetector
from .systems.fk_propagator import FkPropagator as FkPropagator
from .systems.ik.differential_ik import (
    DifferentialInverseKinematics as DifferentialInverseKinematics,
)
from .systems.safety.supervisor import SafetySupervisor as SafetySupervisor
from .systems.tracking.point_tracker import PointTracker as PointTracker
from .systems.visualization.point_set_visualizer import PointSetVisualizer as PointSetVisualizer

__version__: str
