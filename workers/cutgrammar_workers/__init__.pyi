from .trial_worker import EvaluationContext as EvaluationContext
from .trial_worker import TrialWorker as TrialWorker
