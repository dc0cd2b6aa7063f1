"""Methods as entries: a package of one file adds one, and what the entry declares is what the project does."""

import re
from dataclasses import replace

import pytest

from cutgrammar.errors import InputError
from cutgrammar.methods.method import PlanningContext
from cutgrammar.methods.registry import describe_methods, find_method, installed_methods
from cutgrammar.settings import Settings

TABLE_ORDER = [
    *("grammar", "grammar-plus", "guided", "bc", "qnet", "copy", "peel", "halve", "largest", "random"),
    *("human", "transfer", "expert", "expert-rough", "oracle-types", "oracle-parse", "oracle-planes", "replay"),
]

SCRATCH = """
from cutgrammar.methods.method import Method


class Idle:
    def __init__(self, demonstration):
        self.demonstration = demonstration


PLAIN = Method("plain", lambda context: Idle(context.demonstration), "does nothing")
PEEKING = Method("peeking", lambda context: Idle(context.demonstration), sees_demonstration=True)
MISNAMED = Method("another", lambda context: Idle(None))
FUNCTION = print
"""


@pytest.fixture
def scratch(install):
    names = {"plain": "PLAIN", "peeking": "PEEKING", "misnamed": "MISNAMED", "function": "FUNCTION", "torn": "NOTHING"}
    install("scratch_method", SCRATCH, methods=names)


def test_tables_begin_with_the_method_and_end_with_what_sees_the_demonstration():
    assert [method.name for method in installed_methods()] == TABLE_ORDER


def test_every_method_describes_itself_in_one_line_and_unlike_the_others():
    descriptions = [method.description for method in installed_methods()]
    assert all(re.fullmatch(r"[^\n]{10,120}", description) for description in descriptions)
    assert len(set(descriptions)) == len(descriptions)


def test_a_method_of_another_package_is_listed_among_the_competitors(scratch):
    names = [method.name for method in installed_methods()]
    assert names.index("grammar") < names.index("plain") < names.index("bc")
    assert find_method("plain").is_competitor


def test_a_method_of_another_package_that_sees_the_demonstration_is_no_competitor(scratch):
    peeking = find_method("peeking")
    assert peeking.kind == "method"
    assert not peeking.is_competitor
    names = [method.name for method in installed_methods() if method.kind != "unknown"]
    assert names.index("peeking") > names.index("random")


def test_only_a_method_that_declares_it_is_given_the_demonstration(scratch, demonstrate):
    context = PlanningContext(None, Settings(), demonstrate())
    assert find_method("plain").planner(context).demonstration is None
    assert find_method("peeking").planner(context).demonstration is context.demonstration


def test_no_installed_competitor_is_given_the_demonstration(demonstrate):
    """Each factory is replaced by one that keeps what it is given."""
    for method in installed_methods():
        given = replace(method, make_planner=lambda context: context)
        context = given.planner(PlanningContext(None, Settings(), demonstrate(), reproduction=demonstrate()))
        assert (context.demonstration is None and context.reproduction is None) == method.is_competitor
        assert context.demonstration is None or context.reproduction is None


def test_a_method_that_is_not_installed_is_described_and_not_ranked():
    magic, grammar = sorted(describe_methods(["magic", "grammar", "magic"]), key=lambda method: method.kind)[::-1]
    assert (grammar.name, magic.name) == ("grammar", "magic")
    assert (magic.kind, magic.is_competitor, magic.sees_demonstration) == ("unknown", False, False)
    assert magic.description == "method 'magic' is not installed"
    with pytest.raises(InputError, match="method 'magic' is not installed"):
        magic.planner(PlanningContext(None, Settings()))


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("gramar", "method 'gramar' is unknown; known: bc, "),
        ("torn", "scratch_method:NOTHING cannot be loaded"),
        ("function", "scratch_method:FUNCTION is a builtin_function_or_method; .* must be a Method"),
        ("misnamed", "scratch_method:MISNAMED is called 'another', its entry point 'misnamed'"),
    ],
)
def test_the_error_for_an_unusable_entry_names_the_reason(scratch, name, message):
    with pytest.raises(InputError, match=message):
        find_method(name)
    (described,) = describe_methods([name])
    assert (described.name, described.kind) == (name, "unknown")
