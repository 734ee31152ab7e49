from .trials.pool import LostTrial as LostTrial
from .trials.pool import run_trials as run_trials
