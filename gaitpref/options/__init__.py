"""Choosing among gaits: policies in, answers about choices, one policy out."""
