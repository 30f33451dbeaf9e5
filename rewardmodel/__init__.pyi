"""What the package is used by; everything is loaded when it is asked for."""

from .acquisition.choose import choose_pairs as choose_pairs
from .acquisition.information import Information as Information
from .acquisition.strategy import Strategy as Strategy
from .acquisition.strategy import Uniform as Uniform
from .acquisition.uncertainty import Disagreement as Disagreement
from .answers.answered_pairs import AnsweredPairs as AnsweredPairs
from .answers.answered_pairs import load_pairs as load_pairs
from .cfg import FitCfg as FitCfg
from .errors import RewardError as RewardError
from .fitting.fit_reward import fit_reward as fit_reward
from .measures.held_out import fold_of as fold_of
from .models.fit_report import FitReport as FitReport
from .models.model import RewardModel as RewardModel
from .models.storage import load_reward as load_reward
from .models.storage import save_reward as save_reward

__all__ = [
    "AnsweredPairs",
    "Disagreement",
    "FitCfg",
    "FitReport",
    "Information",
    "RewardError",
    "RewardModel",
    "Strategy",
    "Uniform",
    "choose_pairs",
    "fit_reward",
    "fold_of",
    "load_pairs",
    "load_reward",
    "save_reward",
]
