"""A trained policy as files for a robot."""
