"""Learning from a memory of steps: an actor, twin critics, and what is replayed."""
