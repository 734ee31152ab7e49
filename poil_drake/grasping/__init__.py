"""Grasp candidates, their rehearsal, the motions to a grasp, and the plan. No pydrake."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
