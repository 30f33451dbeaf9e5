"""A directory of episodes named by their content, with a manifest and the answers."""
