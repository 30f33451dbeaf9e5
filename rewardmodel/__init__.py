"""From answers to a reward; knows neither simulator nor page."""

from .acquisition import Disagreement as Disagreement
from .acquisition import Uniform as Uniform
from .acquisition import choose_pairs as choose_pairs
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
