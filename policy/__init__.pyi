"""What the package is used by; everything is loaded when it is asked for."""

from .env.env_cfg import EnvCfg as EnvCfg
from .env.known_terms import KnownTermsCfg as KnownTermsCfg
from .offpolicy.off_policy_runner import OffPolicy as OffPolicy
from .offpolicy.sac_cfg import SacCfg as SacCfg
from .robots.robot import Robot as Robot
from .robots.robot import load_robot as load_robot
from .rollouts.evaluate import Evaluation as Evaluation
from .rollouts.evaluate import evaluate as evaluate
from .rollouts.record import record as record
from .rollouts.record_cfg import RecordCfg as RecordCfg
from .training.checkpoint import Policy as Policy
from .training.checkpoint import load_policy as load_policy
from .training.ppo import PpoCfg as PpoCfg
from .training.ppo import ScoreFn as ScoreFn
from .training.session import TrainResult as TrainResult
from .training.train import train as train
from .training.train_cfg import TrainCfg as TrainCfg

__all__ = [
    "EnvCfg",
    "Evaluation",
    "KnownTermsCfg",
    "OffPolicy",
    "Policy",
    "PpoCfg",
    "RecordCfg",
    "Robot",
    "SacCfg",
    "ScoreFn",
    "TrainCfg",
    "TrainResult",
    "evaluate",
    "load_policy",
    "load_robot",
    "record",
    "train",
]
