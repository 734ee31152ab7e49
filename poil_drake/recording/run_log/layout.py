"""The topics and names of a run log that a replay reads, see docs/replaying_a_run.md."""

PLAN_ATTACHMENT = "plan.npz"
STATION_KEY = "station"
"""Metadata: the kind of station, one of the three below."""

REPLAY_OF_KEY, REPLAY_OF_DIGEST_KEY = "replay_of", "replay_of_sha256"
"""Metadata of the log of a replay: the name of the log that was replayed, and its SHA-256."""

REPLAY_TRACKER_KEY, REPLAY_TEXT_KEY = "replay_tracker", "replay_scenario_text"
"""Likewise: the tracker, and the YAML that was laid over the scenario."""

SIMULATED, HARDWARE, DRY_RUN = "simulated", "hardware", "dry_run"

JOINT_STATES_TOPIC = "/robot/joint_states"
JOINT_COMMANDS_TOPIC = "/robot/joint_commands"
ROBOT_STATUS_TOPIC = "/robot/status"
HAND_STATUS_TOPIC = "/hand/status"
TWIST_TOPIC = "/controller/twist"
PHASE_TOPIC = "/phase"
TRACKED_TOPIC = "/points/tracked"
TRACKER_STATUS_TOPIC = "/tracker/status"
TRACKER_TIMES_TOPIC = "/tracker/times"
DETECTOR_TIMES_TOPIC = "/detector/times"
CAMERAS_STATUS_TOPIC = "/cameras/status"
STOPS_TOPIC = "/stop_requests/status"
