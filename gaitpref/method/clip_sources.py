"""What the first questions can be about: how a round's episodes are made to differ."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class ClipSources:
    """What the clips of a round are taken from.

    What all clips have in common, no answer about two of them tells.
    """

    noisy_share: float = 0.5
    """Share of the episodes with exploration noise."""
    rhythm_share: float = 0.0
    """Share of the episodes of an untrained robot that move their legs in a random
    rhythm: who has only seen robots shake, cannot say what walking would be like."""
    posture_share: float = 0.5
    """Share of a policy's episodes in another posture, or with larger steps."""
    earlier_share: float = 0.5
    """Episodes of earlier rounds' policies that are asked about, for every new one."""
