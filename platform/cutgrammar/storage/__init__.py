"""What lies on disk: data sets, splits, ledgers, run folders, and files written atomically."""
