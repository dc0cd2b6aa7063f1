"""cutgrammar: planning object cutting with an attributed stochastic grammar.

What users need is exported here and imported on first use; the stub beside this file lists it.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
