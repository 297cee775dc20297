"""`python -m hierc` is the command `hierc`."""

import sys

from hierc.cli import main

sys.exit(main())
