"""What a rater sees and presses."""
