"""Worlds that carry out a cut, the foods they hold, and the scripted demonstrator."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
