import pytest

from cutgrammar.geometry.mesh_io.repair import UNITS
from cutgrammar.storage.split import RULES
from cutgrammar.trials.goals import GOALS
from cutgrammar_pipelines.cli.commands import build_parser
from cutgrammar_pipelines.cli.main import main
from cutgrammar_pipelines.stages.evaluate import PERCEPTIONS
from cutgrammar_workers.trial_worker import RECORD

COMMANDS = (
    "collect",
    "split",
    "train",
    "evaluate",
    "plan",
    "report",
    "view",
    "film",
    "export",
    "show",
    "sync",
    "study",
    "mlflow",
    "doctor",
)


@pytest.mark.parametrize("command", COMMANDS)
def test_help_teaches(command, capsys):
    with pytest.raises(SystemExit) as ended:
        build_parser().parse_args([command, "--help"])
    assert ended.value.code == 0
    assert len(capsys.readouterr().out) > 150


def test_the_choices_offered_are_those_that_the_commands_know():
    """The command line spells them out, so that it need not import what knows them."""
    (commands,) = (action for action in build_parser()._actions if action.dest == "command")
    for command, option, known in [
        ("evaluate", "goals", GOALS),
        ("evaluate", "perception", PERCEPTIONS),
        ("evaluate", "record", RECORD),
        ("split", "rule", RULES),
        ("collect", "unit", UNITS),
        ("plan", "unit", UNITS),
    ]:
        (action,) = (action for action in commands.choices[command]._actions if action.dest == option)
        assert tuple(action.choices) == tuple(known)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["evaluate", "--data", "d", "--model", "m", "--out", "o", "--metods", "x"], "did you mean --methods?"),
        (["evaluate", "--model", "m", "--out", "o"], "required: --data"),
        (["collect", "--out", "d", "--trials", "0"], "0 is too small; 1 is the least"),
        (["collect", "--out", "d", "--trials", "many"], "'many' is not a whole number"),
        (["collect", "--out", "d", "--unit", "inch"], "invalid choice: 'inch'"),
        (["bake"], "invalid choice: 'bake'"),
        ([], "required: COMMAND"),
    ],
)
def test_a_wrong_option_gives_one_line_and_code_2(words, message, capsys):
    with pytest.raises(SystemExit) as ended:
        main(words)
    said = capsys.readouterr().err
    assert ended.value.code == 2
    assert message in said
    assert said.count("\n") == 1


@pytest.mark.parametrize(
    "words",
    [
        ["collect", "--out", "{new}", "--setups", "N9M9"],
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
    said = capsys.readouterr().err
    assert code == 2, said
    assert said.startswith(f"cutgrammar {words[0]}: ")
    assert said.count("\n") == 1
    assert not new.exists()


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ('methods = ["gramar"]', "method 'gramar' is unknown; known: "),
        ("goals = []", "study.goals is empty; at least one value is needed"),
        ('world = "moon"', "world 'moon' is unknown; known: "),
        ('record = "some"', "record 'some' is unknown; known: none, failed, all"),
    ],
)
def test_a_study_refuses_unknown_names_before_it_begins(line, message, tmp_path, capsys):
    (tmp_path / "mine.toml").write_text(f"[study]\n{line}\n")
    assert main(["study", "--settings", str(tmp_path / "mine.toml"), "--out", str(tmp_path / "out")]) == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("error", "code", "message"),
    [
        (FileNotFoundError(2, "", "/proc/x"), 2, "/proc/x: No such file or directory; choose another place"),
        (OSError(28, ""), 1, "nope: No space left on device; mend it and give the same command again: it begins anew"),
        (ConnectionError("the cluster is gone"), 1, "the cluster is gone; mend it and give the same command again"),
        (KeyboardInterrupt(), 130, "interrupted; give the same command again: it begins anew"),
    ],
)
def test_what_breaks_a_command_off_gives_one_line_and_its_code(error, code, message, monkeypatch, capsys):
    def collect(*_, **__):
        raise error

    monkeypatch.setattr("cutgrammar_pipelines.stages.collect.collect", collect)
    assert main(["collect", "--out", "nope"]) == code
    said = capsys.readouterr().err
    assert said.startswith(f"cutgrammar collect: {message}")
    assert said.count("\n") == 1
