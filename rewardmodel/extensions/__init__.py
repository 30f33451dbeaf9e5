"""What is off by default: other models, and other ways to learn from answers.

docs/reference/extensions.md has a section for each: what it is, its source, what it
measured.
"""
