"""cutgrammar: planning object cutting with an attributed stochastic grammar."""
