"""`python -m gaitpref` is the command `gaitpref`."""

import sys

from gaitpref.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
