"""Findings, figures and pictures of what was learned."""
