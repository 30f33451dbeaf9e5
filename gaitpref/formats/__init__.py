"""Data sets in the formats of other projects, and their answers in ours."""
