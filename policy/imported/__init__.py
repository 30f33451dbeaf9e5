"""Policies that others trained: read, understood, tried, and given back."""
