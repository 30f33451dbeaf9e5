"""Choosing among gaits: options over frozen policies, and what they are worth."""
