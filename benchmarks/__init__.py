"""Measurements; each prints figures, and JSON with --json FILE."""
