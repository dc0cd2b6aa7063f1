import os
import shlex
import subprocess
import sys
from dataclasses import fields
from typing import get_args, get_type_hints

import pytest

from cutgrammar import plugins
from cutgrammar.geometry.mesh_io.bodies import Keep
from cutgrammar.geometry.mesh_io.placing import Up
from cutgrammar.geometry.mesh_io.units import UNITS
from cutgrammar.plugins import FOODS, METHODS, SCORES, WORLDS, names_in
from cutgrammar.storage.split import RULES
from cutgrammar.trials.goals import GOALS
from cutgrammar_pipelines import config
from cutgrammar_pipelines.cli.commands import COMMANDS
from cutgrammar_pipelines.cli.main import main
from cutgrammar_workers.one_thread import ONE_THREAD
from cutgrammar_workers.trial_worker import PERCEPTIONS, RECORD


def test_the_commands_are_those_of_the_contract():
    expected = (
        "collect import record split train evaluate rate plan report view film export show sync study mlflow doctor"
    )
    assert list(COMMANDS) == expected.split()


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_a_help_text_with_an_example(command, monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", "80")
    assert main([command, "--help"]) == 0
    text = capsys.readouterr().out
    assert f"For example:\n  cutgrammar {command}" in text
    assert max(map(len, text.splitlines())) <= 80


def test_the_help_of_an_option_breaks_where_the_terminal_ends_only(monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", "250")
    main(["collect", "--help"])
    assert "(carrot, cucumber, potato, courgette and block if not given)" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("command", "groups"), [("collect", [FOODS]), ("evaluate", [METHODS, WORLDS, SCORES]), ("plan", [METHODS])]
)
def test_help_lists_what_is_installed_with_a_description(command, groups, capsys):
    main([command, "--help"])
    lines = capsys.readouterr().out.splitlines()
    for group in groups:
        for name in names_in(group):
            assert any(line.startswith(f"  {name} ") and len(line.split()) > 3 for line in lines), name


def completed(script, *words):
    """What bash completes the last of these words to, with this script."""
    code = f"""
        . {script}
        COMP_WORDS=({shlex.join(words)}) COMP_CWORD={len(words) - 1}
        _cutgrammar
        echo "${{COMPREPLY[@]}}"
    """
    return subprocess.run(["bash", "-c", code], capture_output=True, text=True, check=True).stdout.split()


def test_a_shell_completes_commands_and_options(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("HOME", str(tmp_path))
    script = tmp_path / "completion"
    assert main(["--install-completion", "--shell", "bash", "--output", str(script)]) == 0
    assert str(script) in capsys.readouterr().out
    assert completed(script, "cutgrammar", "rep") == ["report"]
    assert completed(script, "cutgrammar", "report", "--no-t") == ["--no-timing"]


def test_every_option_has_a_help_text():
    for name in config.__all__:
        cls = getattr(config, name)
        documented = (cls.__doc__ or "").partition("Attributes:")[2]
        shared = {"seed", "settings", "workers", "address", "py_module"}
        for field in fields(cls):
            assert field.name in shared or f"        {field.name}: " in documented, f"{name}.{field.name}"


def test_a_scheduler_does_not_set_the_number_of_threads(monkeypatch):
    for name in ONE_THREAD:
        monkeypatch.setenv(name, "8")
    main(["show", "nothing"])
    assert {os.environ[name] for name in ONE_THREAD} == {"1"}


def test_help_imports_no_heavy_library():
    code = "import sys; from cutgrammar_pipelines.cli.main import main; main(['evaluate', '--help']);"
    code += "print([name for name in ('torch', 'mlflow', 'ray', 'sapien', 'scipy', 'numba') if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"


def choices_of(cls, field):
    """All words of the Literal types in a field's type."""

    def words(hint):
        for part in get_args(hint):
            yield from [part] if isinstance(part, str) else words(part)

    return tuple(words(get_type_hints(cls)[field]))


def test_the_choices_of_the_configs_are_those_that_the_stages_know():
    """The configs spell them out, so that help need not import the stages."""
    for cls, field, known in [
        (config.EvaluateConfig, "goals", GOALS),
        (config.EvaluateConfig, "perception", PERCEPTIONS),
        (config.EvaluateConfig, "record", RECORD),
        (config.SplitConfig, "rule", RULES),
        (config.CollectConfig, "unit", UNITS),
        (config.RecordConfig, "unit", UNITS),
        (config.PlanConfig, "unit", UNITS),
        (config.PlanConfig, "up", get_args(Up)),
        (config.CollectConfig, "bodies", get_args(Keep)),
        (config.PlanConfig, "bodies", get_args(Keep)),
    ]:
        assert choices_of(cls, field) == tuple(known)


EVALUATE = ["evaluate", "--data", "d", "--model", "m", "--out", "o"]
URL = "nope://lab/x"


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ([*EVALUATE, "--metods", "x"], "Did you mean --methods?"),
        (["evaluate", "--model", "m", "--out", "o"], "--data is missing"),
        (["view"], "RUN is missing"),
        (["film", "run"], "TRIAL is missing"),
        ([*EVALUATE, "--runs"], "--runs needs a value"),
        (["view", "run", "trial", "more"], "unexpected argument more"),
        (["collect", "--out", "d", "--trials", "0"], "--trials 0 is too small; the minimum is 1"),
        (["collect", "--out", "d", "--trials", "many"], "--trials many is not a whole number"),
        (["collect", "--out", "d", "--unit", "inch"], "--unit inch is unknown; known: mm, cm, m"),
        (["collect", "--out", "d", "--setups", "N9M9"], "setup 'N9M9' is unknown; known: N1M1, N1M2"),
        (["collect", "--out", "d", "--seed", "-1"], "--seed -1 is too small; the minimum is 0"),
        (["split", "d", "--out", "d", "--share", "1.5"], "--share 1.5 is too large; it must be less than 1"),
        ([*EVALUATE, "--methods", "gramar"], "method 'gramar' is unknown; known: bc, copy, "),
        ([*EVALUATE, "--methods", "gramar"], "; did you mean grammar?"),
        ([*EVALUATE, "--methods"], "--methods is empty; at least one value is needed"),
        (
            [*EVALUATE, "--goals", "upside-down"],
            "--goals upside-down is unknown; known: in-place, scattered, foreign, foreign-food",
        ),
        ([*EVALUATE, "--world", "moon"], "world 'moon' is unknown; known: bench, board, kinova"),
        ([*EVALUATE, "--record", "some"], "--record some is unknown; known: none, failed, all"),
        ([*EVALUATE, "--runs", "0"], "--runs 0 is too small; the minimum is 1"),
        ([*EVALUATE, "--planners", "2", "--workers", "0"], "planners 2 need Ray, and workers 0 does without it"),
        ([*EVALUATE, "--arm", "a.urdf"], "--arm and --flange go together"),
        ([*EVALUATE, "--allow-missing=perhaps"], "--allow-missing"),
        (["collect", "--out", "s3://lab/data"], "s3://lab/data is a URL, and this takes a folder or file of this mach"),
        (["train", "--data", "d", "--out", "s3://lab/model"], "with the store's own tool, e.g. aws s3 cp"),
        (["study", "--out", "file:///srv/study"], "file:///srv/study is a URL"),
        (["report", "s3://lab/run"], "s3://lab/run is a URL"),
        (["view", "s3://lab/run"], "s3://lab/run is a URL"),
        (["show", "d", "--out", "s3://lab/a.png"], "s3://lab/a.png is a URL"),
        (["bake"], 'Unknown command "bake"'),
        (["evalute"], 'Did you mean "evaluate"?'),
        ([], "a command is required"),
    ],
)
def test_a_wrong_option_gives_one_line_and_code_2(words, message, capsys):
    assert main(words) == 2
    error = capsys.readouterr().err
    assert error.startswith("cutgrammar")
    assert message in error
    assert error.count("\n") == 1


READING_PLACES = (
    [*EVALUATE, "--data", URL],
    [*EVALUATE, "--model", URL],
    [*EVALUATE, "--model", "m", URL],
    [*EVALUATE, "--human", "d", URL],
    [*EVALUATE, "--record", "all", "--artifacts", URL],
    ["train", "--out", "m", "--data", URL],
    ["split", "d", URL, "--out", "d"],
    ["plan", "--now", "a.stl", "--goal", "b.stl", "--model", URL],
    ["record", "--out", "d", "--reproduce", URL],
    ["show", URL],
    ["show", "m", "--out", "a.png", "--data", URL],
)


@pytest.mark.parametrize("words", READING_PLACES)
def test_whatever_reads_a_data_set_or_a_model_takes_urls(words, capsys):
    assert main(words) == 2
    assert f"{URL} cannot be used: Unrecognized filesystem type" in capsys.readouterr().err


def test_the_last_of_a_repeated_option_counts(capsys):
    assert main([*EVALUATE, "--runs", "0", "--runs", "1", "--world", "moon", "--trials", "1", "--trials", "0"]) == 2
    error = capsys.readouterr().err
    assert "--trials 0 is too small" in error or "'moon' is unknown" in error
    assert "--runs" not in error


@pytest.mark.parametrize(
    "words",
    [
        ["collect", "--out", "{new}", "--foods", "pizza"],
        ["collect", "--out", "{new}", "--foods", "{new}/none.stl"],
        ["collect", "--out", "{new}", "--settings", "{new}/none.toml"],
        ["split", "{new}", "--out", "{new}"],
        ["train", "--data", "{new}", "--out", "{new}/model"],
        ["evaluate", "--data", "{new}", "--model", "{new}", "--out", "{new}/run"],
        ["plan", "--model", "{new}", "--now", "{new}/a.stl", "--goal", "{new}/b.stl"],
        ["report", "{new}"],
        ["view", "{new}"],
        ["film", "{new}", "a"],
        ["export", "{new}", "a", "--out", "{new}/a.json"],
        ["show", "{new}"],
        ["sync", "{new}"],
        ["study", "--settings", "{new}/none.toml", "--out", "{new}"],
    ],
)
def test_missing_or_unknown_input_gives_one_line_and_code_2(words, tmp_path, capsys):
    new = tmp_path / "nothing-here"
    code = main([word.format(new=new) for word in words])
    error = capsys.readouterr().err
    assert code == 2, error
    assert error.startswith(f"cutgrammar {words[0]}: ")
    assert error.count("\n") == 1
    assert not new.exists()


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ('methods = ["gramar"]', "method 'gramar' is unknown; known: "),
        ("goals = []", "evaluate.goals is empty; at least one value is needed"),
        ('world = "moon"', "world 'moon' is unknown; known: "),
        ('record = "some"', "evaluate.record = 'some' is unknown; known: none, failed, all"),
    ],
)
def test_a_study_refuses_unknown_names_before_it_begins(line, message, tmp_path, capsys):
    (tmp_path / "mine.toml").write_text(f"[evaluate]\n{line}\n")
    assert main(["study", "--settings", str(tmp_path / "mine.toml"), "--out", str(tmp_path / "out")]) == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_study_prints_its_settings_file(capsys):
    assert main(["study", "--preset", "paper", "--print"]) == 0
    assert '[evaluate]\nmethods = ["grammar", ' in capsys.readouterr().out


@pytest.mark.parametrize(
    ("error", "code", "message"),
    [
        (FileNotFoundError(2, "", "/proc/x"), 2, "/proc/x: No such file or directory; choose another place"),
        (OSError(28, ""), 1, "nope: No space left on device; correct this and run the same command again: it starts"),
        (ConnectionError("the cluster is gone"), 1, "the cluster is gone; correct this and run the same command again"),
        (KeyboardInterrupt(), 130, "interrupted; run the same command again, it starts from the beginning"),
    ],
)
def test_an_interruption_gives_one_line_and_its_code(error, code, message, monkeypatch, capsys):
    def split(_):
        raise error

    monkeypatch.setattr("cutgrammar_pipelines.stages.splitting.split", split)
    assert main(["split", "data", "--out", "nope"]) == code
    printed = capsys.readouterr().err
    assert printed.startswith(f"cutgrammar split: {message}")
    assert printed.count("\n") == 1


@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_a_reader_that_leaves_early_causes_no_error_message(unbuffered, monkeypatch):
    monkeypatch.setenv("PYTHONUNBUFFERED", unbuffered)
    command = [sys.executable, "-m", "cutgrammar_pipelines", "study", "--preset", "demo", "--print"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        process.stdout.close()
        assert process.stderr.read() == ""
    assert process.returncode == 141


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("none", "is neither the folder of a Python package nor a .py file"),
        ("plugin-1.0-py3-none-any.whl", "is a wheel; give the folder of its package, as installed here"),
        ("project", "holds packages and is none; give {}/project/src/unknown_plugin"),
        ("project/src/unknown_plugin", "import unknown_plugin finds nothing in this process; install the package here"),
        ("cutgrammar", "import cutgrammar finds "),
    ],
)
def test_a_wrong_py_module_gives_one_line_and_code_2(name, message, tmp_path, capsys):
    for folder in ("project/src/unknown_plugin", "cutgrammar"):
        (tmp_path / folder).mkdir(parents=True)
        (tmp_path / folder / "__init__.py").touch()
    assert main([*EVALUATE, "--py-module", str(tmp_path / name)]) == 2
    error = capsys.readouterr().err
    assert message.format(tmp_path) in error
    assert error.count("\n") == 1


def test_a_py_module_is_the_one_that_this_process_imports():
    chosen = config.CollectConfig(out="d", py_module=[plugins.__file__.replace("/plugins.py", "")])
    assert [path.name for path in chosen.py_module] == ["cutgrammar"]
