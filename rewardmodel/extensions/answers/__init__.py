"""Other ways to treat answers."""
