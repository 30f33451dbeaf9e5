"""Kinds of reward model, ensembles of them, and their files."""
