"""The loop: one stage a file, from finished files to finished files."""
