"""The command line: options, one module a command."""
