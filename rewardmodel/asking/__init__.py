"""Questions for people, by the name of the strategy that chose them."""
