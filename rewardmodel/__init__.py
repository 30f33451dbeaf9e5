"""From answers to a reward; knows neither simulator nor page."""

from .acquisition import Disagreement as Disagreement
from .acquisition import Uniform as Uniform
from .acquisition import choose_pairs as choose_pairs
from .cfg import FitCfg as FitCfg
from .errors import RewardError as RewardError
from .fit import fit_reward as fit_reward
from .held_out import fold_of as fold_of
from .model import RewardModel as RewardModel
from .pairs import AnsweredPairs as AnsweredPairs
from .pairs import load_pairs as load_pairs
from .report import FitReport as FitReport
from .storage import load_reward as load_reward
from .storage import save_reward as save_reward
