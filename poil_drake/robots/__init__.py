"""The Panda as data and maths: kinematics, limits, shape, posture and IK. No pydrake."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
