"""`python -m cutgrammar_pipelines` is `cutgrammar`."""

import sys

from cutgrammar_pipelines.cli.main import main

sys.exit(main())
