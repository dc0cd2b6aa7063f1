"""4. Evaluate methods on test trials and print the table.

Run: python docs/examples/04_evaluate_and_report.py [FOLDER]       (the folder of example 2)
"""

import sys
from pathlib import Path

from cutgrammar_pipelines import EvaluateConfig, as_text, build_report, evaluate

folder = Path(sys.argv[1] if len(sys.argv) > 1 else "example")
summary = evaluate(
    EvaluateConfig(
        data=folder / "data",
        model=folder / "model",
        out=folder / "run",
        methods=("grammar", "random", "replay"),
        setups=("N1M1", "N2M1"),
        runs=1,
        trials=1,
        world="bench",
        record="all",
        workers=0,
    )
)
assert summary.complete
print(as_text(build_report([folder / "run"])))
print("recordings:", *sorted(path.name for path in (folder / "run" / "recordings").iterdir()), sep="\n  ")
