"""``python -m jointscope`` is the console script."""

import sys

from jointscope.cli import main

if __name__ == "__main__":
    sys.exit(main())
