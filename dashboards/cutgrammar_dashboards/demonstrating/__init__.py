"""The page on which people cut foods by hand, and what it keeps."""
