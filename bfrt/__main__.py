"""``python -m bfrt`` is the command ``bfrt``."""

import sys

from bfrt.cli import main

sys.exit(main())
