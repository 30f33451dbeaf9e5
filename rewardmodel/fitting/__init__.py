"""From answers to a reward."""
