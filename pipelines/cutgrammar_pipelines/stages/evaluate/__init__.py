"""Evaluate: plan which trials, carry them out, record where they come from, and reproduce them."""

from cutgrammar_pipelines.stages.evaluate.run_trials import Summary, evaluate

__all__ = ["Summary", "evaluate"]
