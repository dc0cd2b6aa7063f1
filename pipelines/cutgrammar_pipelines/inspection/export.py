"""The motions of an arm in a trial, as files for a real arm: our own JSON, and ROS's JointTrajectory as YAML."""

from cutgrammar.atomic_files import write_atomic
from cutgrammar.errors import InputError
from cutgrammar.settings import Settings, from_tables
from cutgrammar.storage.run_folder import read_run
from cutgrammar.trials.trajectory import to_ros_yaml, trajectory_of, trajectory_to_json
from cutgrammar_pipelines.config import ExportConfig
from cutgrammar_pipelines.inspection.trial_trace import trace_trial

WRITERS = {".json": trajectory_to_json, ".yaml": to_ros_yaml, ".yml": to_ros_yaml}


def export(config: ExportConfig) -> int:
    """Write the joint trajectories of a trial, and report whether they keep the arm's limits at every sample.

    Returns:
        0, or 2 if limits are exceeded, after a line for each of them; the files are written in both cases.

    Raises:
        InputError: no run, no such trial, no arm moved in it, it cannot be reproduced, or `out` has an unknown suffix.
    """
    run, out, rate = config.run, config.out, config.rate
    if out.suffix and out.suffix not in WRITERS and not out.is_dir():
        raise InputError(f"--out {out} is neither .json, .yaml nor a folder; give one of these")
    trace, _ = trace_trial(run, config.trial, by_arm=True)
    name, settings = trace.record.key.name, from_tables(read_run(run).settings, str(run / "run.json"))
    trajectory = trajectory_of(trace.events, name, _arm_in(trace.record.key.world, settings))
    if trajectory is None:
        raise InputError(f"no arm moved in {name} when it was carried out again; see the note above")
    broken = trajectory.violations()
    written = trajectory if rate is None else trajectory.thinned(rate)
    for file in [out] if out.suffix in WRITERS else [out / f"{name}.json", out / f"{name}.yaml"]:
        file.parent.mkdir(parents=True, exist_ok=True)
        write_atomic(file, WRITERS[file.suffix](written))
        print(file)
    seconds = sum(cut.times[-1] for cut in trajectory.cuts)
    points = sum(len(cut.times) for cut in written.cuts)
    print(f"{len(trajectory.cuts)} cuts, {seconds:.1f} s, {points} points of {len(trajectory.joints)} joints")
    if not broken:
        print("limits: kept")
        return 0
    for line in broken:
        print(f"limits: {line}")
    return 2


def _arm_in(world: str, settings: Settings) -> str:
    """Name of the arm in a world called so."""
    if world != "kinova":
        return f"the arm of the world {world}"
    if settings.kinova.urdf:
        from cutgrammar_sim.arm.robot.urdf import read_urdf  # few users have another arm

        return read_urdf(settings.kinova.urdf, settings.kinova.flange).name
    from cutgrammar_sim.arm.robot.gen3 import gen3

    return gen3().name
