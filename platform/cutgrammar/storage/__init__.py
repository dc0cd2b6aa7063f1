"""Files on disk: data sets, splits, ledgers and run folders."""
