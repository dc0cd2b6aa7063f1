"""Collect, split, train, evaluate, report; the command line that puts it all together."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
