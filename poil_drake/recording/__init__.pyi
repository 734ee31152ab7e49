from .comparison.run_comparison import compare_runs as compare_runs
from .demonstration.demonstration import LoadDemonstration as LoadDemonstration
from .demonstration.demonstration import load_demonstration as load_demonstration
from .demonstration.writer import DemonstrationWriter as DemonstrationWriter
from .ros_bag.bag_import import import_ros_bag as import_ros_bag
from .run_log.reader import load_recorded_run as load_recorded_run
from .run_log.recorded_run import RecordedRun as RecordedRun
from .run_log.writer import RunLogWriter as RunLogWriter
