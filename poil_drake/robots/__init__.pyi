from .panda_kinematics import PandaModel as PandaModel
from .posture_guard import PostureGuard as PostureGuard
from .twist_resolution import (
    DifferentialInverseKinematicsConfig as DifferentialInverseKinematicsConfig,
)
from .velocity_limiter import VelocityLimiter as VelocityLimiter
