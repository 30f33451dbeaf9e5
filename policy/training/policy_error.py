"""What is wrong with a policy file or with a training."""

from __future__ import annotations

from data.errors import GaitprefError


class PolicyError(GaitprefError):
    """A policy file cannot be used."""
