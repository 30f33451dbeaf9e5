"""Other ways to choose questions."""
