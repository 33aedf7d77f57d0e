"""`python -m swath`: the command line."""

import sys

from swath.commands.main import main

if __name__ == "__main__":
    sys.exit(main())
