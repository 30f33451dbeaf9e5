"""Networks out of files of others, without running anything in them."""
