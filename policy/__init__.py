"""The simulated robot, its environment, PPO training, recording and evaluation."""

import os

# RSL-RL imports GitPython, which refuses to load on a machine without git.
os.environ.setdefault("GIT_PYTHON_REFRESH", "quiet")
