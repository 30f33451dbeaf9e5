"""What the numbers of a policy mean: the law it was trained under, as a record."""
