"""`python -m vispeg`: the same as the command `vispeg`."""

import sys

from vispeg.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
