"""The labeling page; knows no torch."""
