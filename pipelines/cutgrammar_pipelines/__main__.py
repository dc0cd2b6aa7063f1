"""The program `cutgrammar`, also run as `python -m cutgrammar_pipelines`."""

import gc
import sys


def main() -> int:
    """Run the command line and return its exit code.

    Help makes many lasting objects and no garbage. Without the garbage collector it takes two thirds of the time;
    `cli.main` enables the collector before it runs a command.
    """
    gc.disable()
    from cutgrammar_pipelines.cli.main import main as run_command_line

    code = run_command_line()
    if not gc.isenabled():
        gc.freeze()  # or all objects would be collected at exit
    return code


if __name__ == "__main__":
    sys.exit(main())
