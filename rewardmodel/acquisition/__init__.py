"""Which pairs of clips to ask about next."""

from .choose import asked_for as asked_for
from .choose import choose_pairs as choose_pairs
from .information import Information as Information
from .phase import in_step as in_step
from .strategy import Strategy as Strategy
from .strategy import Uniform as Uniform
from .uncertainty import Disagreement as Disagreement
