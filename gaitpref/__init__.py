"""The application: command line, the loop, run directories and their report."""

import lazy_loader

# A labeler's machine has no Gymnasium; all others find the environment by its name.
try:
    from .adapters.gym_registration import register
except ModuleNotFoundError as error:
    if (error.name or "").partition(".")[0] == __name__:
        raise
else:
    register()

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
__version__ = "0.1.0"
