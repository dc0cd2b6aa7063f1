"""How alike two fragments are: volume overlap, refined overlap, spectral distance."""
