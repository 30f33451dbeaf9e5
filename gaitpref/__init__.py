"""The application: command line, the loop, run directories and their report."""

__version__ = "0.1.0"
