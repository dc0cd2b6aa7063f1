"""Writes recordings and reads them back."""

from datetime import timedelta

from rerun.chunk import RrdReader

from cutgrammar_dashboards.recording.recorder import Recorder


def record(path, start, goal, events):
    recorder = Recorder(path, "N1M1, trial 0", start, goal)
    for event in events:
        recorder(event)
    recorder.close()
    return path


def rows(path, entity, component, timeline):
    """[(time, step, value), ...] of one component of one entity, by time on `timeline`; statics have neither."""
    result = []
    for chunk in RrdReader(str(path)).stream():
        batch = chunk.to_record_batch()
        if chunk.entity_path != entity or component not in batch.schema.names:
            continue
        columns = batch.to_pydict()
        blank = [None] * batch.num_rows
        times = [t.total_seconds() if isinstance(t, timedelta) else t for t in columns.get(timeline, blank)]
        steps = columns.get("step", blank)
        result += [row for row in zip(times, steps, columns[component], strict=True) if row[2] is not None]
    return sorted(result, key=lambda row: (row[0] is not None, row[0]))
