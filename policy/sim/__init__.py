"""Simulators: many copies of one robot, advanced together."""
