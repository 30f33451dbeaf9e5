"""Bags of robots as episodes."""
