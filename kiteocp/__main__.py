"""``python -m kiteocp`` is the command ``kiteocp``."""

import sys

from kiteocp.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
