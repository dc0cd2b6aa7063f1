"""`python -m cutgrammar_pipelines` is `cutgrammar`."""

import sys

from cutgrammar_pipelines.command_line import main

sys.exit(main())
