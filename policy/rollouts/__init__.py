"""What a policy does: episodes recorded, variations of them, and figures."""
