"""The one exception of this package a caller reacts to."""

from data.errors import GaitprefError


class RewardError(GaitprefError):
    """A reward cannot be fitted, read or asked; the message says what to do."""
