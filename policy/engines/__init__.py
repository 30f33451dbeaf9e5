"""Actors that collect rollouts elsewhere, and a learner that uses them."""
