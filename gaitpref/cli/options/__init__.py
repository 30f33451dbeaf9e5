"""What each command can be told; light enough for `--help`."""
