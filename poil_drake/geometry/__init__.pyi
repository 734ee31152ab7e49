from .point_cloud import PointCloud as PointCloud
from .rigid_transform import inverse as inverse
from .rigid_transform import make_transform as make_transform
from .rigid_transform import rotation_exp as rotation_exp
from .rigid_transform import rotation_log as rotation_log
from .rigid_transform import skew as skew
from .rigid_transform import transform_points as transform_points
