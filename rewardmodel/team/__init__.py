"""What a team is worth: shares of its robots and of the pair, from answers about both."""
