"""What a team is worth, from answers about it: shares of its robots and of the pair."""
