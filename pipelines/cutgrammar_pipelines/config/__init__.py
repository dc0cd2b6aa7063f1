"""One frozen class for each command: the command line, the Python functions and the study file all build these.

A config is checked when it is built. Its docstring is the help text of the command.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
