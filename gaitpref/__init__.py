"""The application: command line, the loop, run directories and their report."""

import contextlib

# A labeler's machine has no Gymnasium; all others find the environment by its name.
with contextlib.suppress(ModuleNotFoundError):
    from .gym_registration import register

    register()

__version__ = "0.1.0"
