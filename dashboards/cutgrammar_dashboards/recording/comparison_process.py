"""The process that makes one recording of several untrusted ones; `comparison` runs it.

Stdin has JSON: what each column is called, where it lies in the new recording and its file; the new recording's title;
and the file to write. The import of rerun starts threads, so it stands in `main` (see `parser_processes`).
"""

import json
import sys

from cutgrammar.untrusted.parser_processes import limit_this_process


def main() -> int:
    """Write the recording."""
    limit_this_process()
    from cutgrammar_dashboards.recording.joining import join

    return join(json.loads(sys.stdin.buffer.read()))


if __name__ == "__main__":
    sys.exit(main())
