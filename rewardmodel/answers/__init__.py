"""Answers and the clips they are about, as tensors, and how likely an answer is."""
