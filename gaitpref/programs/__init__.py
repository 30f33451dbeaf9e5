"""Raters that are programs: functions, and vision models that are shown pictures."""
