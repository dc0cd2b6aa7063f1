"""From records to results: statistics, comparisons, score tables."""
