"""Other ways to train, each a setting of `PpoCfg` that is None by default.

A module holds the settings, and what they `make`; `policy.training.reward_ppo` says
what it asks of that. What each is good for is told in docs/reference/extensions.md.
"""
