"""The files that ship: a robot, and a policy that walks on it."""

from __future__ import annotations

from pathlib import Path

WALK = Path(__file__).with_name("go1_walk.pt")
"""A policy file of the Go1 that follows commands of 0.2 to 1.1 m/s, trained by
`python -m benchmarks.shipped_walk`."""
