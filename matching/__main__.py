"""`python -m matching` is `rigmatch`."""

import sys

INTERRUPTED = 130

try:
    from rigmatch import main
except KeyboardInterrupt:  # while it starts
    print("rigmatch: interrupted", file=sys.stderr)
    sys.exit(INTERRUPTED)

sys.exit(main())
