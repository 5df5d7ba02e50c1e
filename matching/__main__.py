"""`python -m matching` is `rigmatch`."""

import sys

from rigmatch import main

sys.exit(main())
