"""What the package is used by; everything is loaded when it is asked for."""

from .label_server import LabelCfg as LabelCfg
from .label_server import LabelServer as LabelServer

__all__ = [
    "LabelCfg",
    "LabelServer",
]
