from .images import CameraModel as CameraModel
from .images import MultiViewFrame as MultiViewFrame
from .images import RgbdImage as RgbdImage
from .tracked_points import TrackedPoints as TrackedPoints
