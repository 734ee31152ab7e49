from .field.point_set_bcsdm import BcsdmConfig as BcsdmConfig
from .reference.make_reference import make_reference as make_reference
from .reference.point_trajectory import PointTrajectory as PointTrajectory
