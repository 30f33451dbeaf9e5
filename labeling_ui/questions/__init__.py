"""What a rater is asked, and what the rater did with it."""
