"""What of a course stands in a model and in an episode, for all who show or read it."""

from __future__ import annotations

BAR_PREFIX = "gaitpref_bar_"
"""What the names of bars, bodies of their own, begin with."""
