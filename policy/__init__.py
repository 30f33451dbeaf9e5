"""The simulated robot, its environment, PPO training, recording and evaluation."""

import os

import lazy_loader

# RSL-RL imports GitPython, which refuses to load on a machine without git.
os.environ.setdefault("GIT_PYTHON_REFRESH", "quiet")

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
