"""python -m luxel: the same as the command `luxel`."""

import sys

from luxel.cli import main

sys.exit(main())
