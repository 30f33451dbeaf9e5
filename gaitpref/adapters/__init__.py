"""The environment and the reward in the interfaces of other trainers."""
