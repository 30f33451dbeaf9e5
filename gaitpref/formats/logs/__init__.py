"""Logs of robots as episodes, whatever file they come from."""
