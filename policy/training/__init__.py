"""PPO on RSL-RL, its networks, checkpoints and what can be done with them."""
