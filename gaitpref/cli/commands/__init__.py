"""One module a command: what it does, with everything it needs imported."""
