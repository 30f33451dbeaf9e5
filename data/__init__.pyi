"""What the package is used by; everything is loaded when it is asked for."""

from .answers.answer_records import Answer as Answer
from .answers.answer_records import Choice as Choice
from .answers.answer_records import Pair as Pair
from .answers.store import AnswerStore as AnswerStore
from .datasets.dataset import Dataset as Dataset
from .episodes.clips import Clip as Clip
from .episodes.clips import cut_clips as cut_clips
from .episodes.episode import Episode as Episode
from .episodes.episode import read_episode as read_episode
from .errors import GaitprefError as GaitprefError
from .features import FEATURE_DIM as FEATURE_DIM
from .features import FEATURES as FEATURES
from .features import column as column

__all__ = [
    "FEATURES",
    "FEATURE_DIM",
    "Answer",
    "AnswerStore",
    "Choice",
    "Clip",
    "Dataset",
    "Episode",
    "GaitprefError",
    "Pair",
    "column",
    "cut_clips",
    "read_episode",
]
