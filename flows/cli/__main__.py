"""`python -m flows.cli`: the same as `dcap`."""

import sys

from flows.cli import main

sys.exit(main())
