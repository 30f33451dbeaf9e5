"""Tables of others as episodes, by a map of their columns."""
