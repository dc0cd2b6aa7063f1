from .inspection.export import export as export
from .reports.build import build_report as build_report
from .reports.text import as_text as as_text
from .stages.collect import collect as collect
from .stages.evaluate import evaluate as evaluate
from .stages.plan import plan as plan
from .stages.splitting import split as split
from .stages.train import train as train
