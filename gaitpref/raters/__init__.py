"""Criteria, and raters who judge by them."""
