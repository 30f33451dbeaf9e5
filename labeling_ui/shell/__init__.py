"""What is put around viser's page: connection, keys, names, in words for raters."""
