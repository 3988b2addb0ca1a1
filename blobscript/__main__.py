"""`python -m blobscript` is the command `blobscript`."""

import sys

from blobscript.cli import main

__all__: list[str] = []

if __name__ == "__main__":
    sys.exit(main())
