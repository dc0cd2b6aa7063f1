"""The edge of the platform: files, texts and numbers of strangers, checked before anything else sees them.

A file is opened in one place (`files`), JSON and TOML are parsed in one place (`documents`) with limits on size,
nesting and numbers, plain data are checked against one schema for each reader (`schemas`, `kinds`), memory is bounded
where a library decompresses (`memory`, `archives`), a library that a crafted file can kill reads it in a process of its
own (`parser_processes`), and text is made printable in one place (`printing`). The names of the stub beside this file
are imported on first use.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
