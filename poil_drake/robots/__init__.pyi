from .differential_ik import (
    DifferentialInverseKinematicsConfig as DifferentialInverseKinematicsConfig,
)
from .panda_kinematics import PandaModel as PandaModel
from .posture_guard import PostureGuard as PostureGuard
from .velocity_limiter import VelocityLimiter as VelocityLimiter
