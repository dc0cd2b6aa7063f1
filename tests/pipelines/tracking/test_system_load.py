import threading

from cutgrammar_pipelines.tracking.system_load import watch_system


def test_the_load_is_sampled_while_something_runs_under_mlflows_own_names():
    before = threading.active_count()
    with watch_system(period=0.01) as history:
        while len(history.get("system/system_memory_usage_percentage", ())) < 3:
            threading.Event().wait(0.01)
    assert set(history) == {
        "system/cpu_utilization_percentage",
        "system/system_memory_usage_megabytes",
        "system/system_memory_usage_percentage",
    }
    times = [moment for moment, _ in history["system/cpu_utilization_percentage"]]
    assert times == sorted(times)
    assert all(0 <= value <= 100 for _, value in history["system/system_memory_usage_percentage"])
    assert threading.active_count() == before


def test_what_ends_before_the_first_sample_has_no_history():
    with watch_system(period=60.0) as history:
        pass
    assert history == {}
