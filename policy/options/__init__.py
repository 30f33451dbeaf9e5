"""Choosing among gaits: options over frozen policies, and how their values are learned."""
