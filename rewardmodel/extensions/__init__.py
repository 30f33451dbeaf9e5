"""What is off by default: other models, and other ways to learn from answers.

Each has a section in docs/reference/extensions.md: what it is, its source, and what it
measured.
"""
