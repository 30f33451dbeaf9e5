"""Policies against one another: blind answers, and a ranking with intervals."""
