"""The attributed stochastic grammar of fragmentation (Section II): productions, corpus, induction."""
