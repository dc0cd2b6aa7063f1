"""The attributed stochastic grammar of object fragmentation and its induction from demonstrations (II)."""
