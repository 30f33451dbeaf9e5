"""Networks that others made, as a list of operations and their weights."""
