"""How much is kept of what people type, in one place."""

from __future__ import annotations

NAME_CHARS = 40
"""The name of a rater who has a token."""
RATER_ID_CHARS = 200
"""What any rater is called in a store; programs have longer names than people."""
NOTE_CHARS = 1000
"""A note, and the reason why a clip is bad."""
