"""A record or a live trial made visible."""

import os

import lazy_loader

os.environ.setdefault("RUST_LOG", "warn,re_log_encoding::rrd::file_sink=error")
"""What rerun prints: not that recordings have no footer, which is intended (see `recording.writer`)."""

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
