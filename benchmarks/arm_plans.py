"""How the arm would make the cuts of a data set: in place, with a carry, or not and why; and the time of a plan.

    python benchmarks/arm_plans.py DATA [--every 1] [--arm FILE.urdf --flange NAME]

Each cut is planned by itself, among fragments that lie as the demonstration had them; nothing is simulated. Ends with
exit code 1 if more than 5 % are refused.
"""

import argparse
import re
import sys
import time
from collections import Counter, defaultdict
from pathlib import Path

import numpy as np

from cutgrammar.interfaces import Refused
from cutgrammar.settings import Settings
from cutgrammar.storage.data_set import DataSet
from cutgrammar_sim.arm.planning.cut_plan import plan_cut
from cutgrammar_sim.arm.planning.rig import Rig, rig_of
from cutgrammar_sim.arm.robot.gen3 import gen3
from cutgrammar_sim.arm.robot.tool import knife
from cutgrammar_sim.arm.robot.urdf import read_urdf

MAX_REFUSED = 0.05
"""Largest share of refused cuts."""
FORCE = 30.0
"""Force of the food on the blade [N]."""


def plan_all(data: DataSet, rig: Rig, every: int) -> tuple[Counter[str], Counter[str], dict[str, list[float]]]:
    """Number of cuts by outcome, the reasons of refusals, and CPU times by outcome [s]."""
    outcomes: Counter[str] = Counter()
    reasons: Counter[str] = Counter()
    times: dict[str, list[float]] = defaultdict(list)
    number = 0
    for summary in data.trials:
        demonstration = data.demonstration(summary.trial)
        for cut in demonstration.cuts:
            number += 1
            if number % every or cut.undone:
                continue
            now = demonstration.configuration(cut.step - 1)
            meant = (demonstration.alive(cut.step - 1).index(cut.fragment),)
            started = time.process_time()
            plan = plan_cut(now, meant, cut.plane_W, rig, np.asarray(rig.arm.home), FORCE)
            if isinstance(plan, Refused):
                outcome = "refused"
                reasons[re.sub(r"\d+", "#", plan.reason)] += 1
            elif plan.carry is None:
                outcome = "where it lies"
            else:
                outcome = "carried and turned" if plan.carry.turned_deg > 1.0 else "carried"
            if not isinstance(plan, Refused) and plan.set_aside:
                outcome = "others set aside"
            times[outcome].append(time.process_time() - started)
            outcomes[outcome] += 1
    return outcomes, reasons, times


def main() -> int:
    """Plan all cuts and print the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path)
    parser.add_argument("--every", type=int, default=1)
    parser.add_argument("--arm", type=Path)
    parser.add_argument("--flange", default="flange")
    options = parser.parse_args()
    settings = Settings()
    arm = gen3() if options.arm is None else read_urdf(options.arm.read_text(), options.flange)
    outcomes, reasons, times = plan_all(
        DataSet.open(options.data), rig_of(arm, knife(settings), settings), options.every
    )
    total = sum(outcomes.values())
    print(f"{total} cuts, {arm.name}")
    for outcome, count in outcomes.most_common():
        median, longest = np.median(times[outcome]), np.max(times[outcome])
        print(f"{outcome:20} {count:5} {count / total:7.1%}   CPU {median * 1e3:5.0f} ms, at most {longest * 1e3:.0f}")
    for reason, count in reasons.most_common():
        print(f"  {count:4} {reason}")
    return int(outcomes["refused"] > MAX_REFUSED * total)


if __name__ == "__main__":
    sys.exit(main())
