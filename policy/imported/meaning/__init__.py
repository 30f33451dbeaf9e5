"""What the numbers of a policy of others mean, by what lies beside its file."""
