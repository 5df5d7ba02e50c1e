"""`python -m matching` is `rigmatch`."""

import sys

from matching.cli import main

sys.exit(main())
