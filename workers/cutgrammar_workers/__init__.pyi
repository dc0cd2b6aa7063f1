from .world_actor import EvaluationContext as EvaluationContext
from .world_actor import TrialWorker as TrialWorker
