"""What the package is used by; everything is loaded when it is asked for."""

from .formats.logs.from_qpos import steps_from_qpos as steps_from_qpos
from .library.data_sets import Judge as Judge
from .library.data_sets import answer as answer
from .library.data_sets import ask as ask
from .library.data_sets import open_dataset as open_dataset
from .library.data_sets import record as record
from .library.rewards import fit as fit
from .library.rewards import score_episode as score_episode
from .library.trainings import train_on as train_on
from .loop.loop_cfg import LoopCfg as LoopCfg
from .loop.loop_cfg import RunError as RunError
from .loop.loop_cfg import StepsCfg as StepsCfg
from .loop.presets import loop_cfg as loop_cfg
from .loop.run import run_loop as run_loop
from .method.context import RoundContext as RoundContext
from .method.method import FROM_SCRATCH as FROM_SCRATCH
from .method.method import STYLE as STYLE
from .method.method import Method as Method
from .programs.program_cfg import ProgramCfg as ProgramCfg
from .programs.program_cfg import ReachCfg as ReachCfg
from .programs.seen_pair import SeenPair as SeenPair
from .raters.criteria import Criterion as Criterion
from .raters.criteria import load_criterion as load_criterion
from .raters.rater_cfg import RaterCfg as RaterCfg
from .report.verdict import Verdict as Verdict
from .training.total_reward import TotalReward as TotalReward
from .training.total_reward import total_reward as total_reward

__all__ = [
    "FROM_SCRATCH",
    "STYLE",
    "Criterion",
    "Judge",
    "LoopCfg",
    "Method",
    "ProgramCfg",
    "RaterCfg",
    "ReachCfg",
    "RoundContext",
    "RunError",
    "SeenPair",
    "StepsCfg",
    "TotalReward",
    "Verdict",
    "answer",
    "ask",
    "fit",
    "load_criterion",
    "loop_cfg",
    "open_dataset",
    "record",
    "run_loop",
    "score_episode",
    "steps_from_qpos",
    "total_reward",
    "train_on",
]

__version__: str
