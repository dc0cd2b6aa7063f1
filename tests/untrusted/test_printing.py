"""What strangers wrote does not command a terminal."""

import io

from cutgrammar.untrusted.printing import one_line, printable, printing_safely, shortened, unescaped


def test_control_characters_become_escapes_and_other_text_stays():
    assert printable("a\tb\nc é 切 …") == "a\tb\nc é 切 …"
    assert printable("\x1b[2J\x07\x9b1m\u202e\r\ud800") == "\\x1b[2J\\x07\\x9b1m\\u202e\\r\\ud800"


def test_a_line_is_one_line_and_loses_its_middle_if_it_is_long():
    assert one_line("a\nb  c") == "a b  c"
    assert len(one_line("x" * 1_000_000)) < 1_100


def test_values_are_shown_by_their_beginning():
    deep = []
    for _ in range(100_000):
        deep = [deep]
    for value in ("x" * 1000, [1] * 1000, 10**5000, deep, {"a": "y" * 1000}):
        assert len(shortened(value)) < 120
    assert shortened("a") == "'a'"


def test_what_is_printed_in_a_block_is_escaped_and_what_is_drawn_is_not():
    import sys

    out, err = io.StringIO(), io.StringIO()
    with printing_safely(out, err):
        print("a\x1bb")
        print("c\x07", file=sys.stderr)
        unescaped(sys.stdout).write("\x1b[0m")
    assert out.getvalue() == "a\\x1bb\n\x1b[0m"
    assert err.getvalue() == "c\\x07\n"
