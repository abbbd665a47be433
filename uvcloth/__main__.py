"""`python -m uvcloth` is the `uvcloth` command."""

import sys

from uvcloth.cli import main

sys.exit(main())
