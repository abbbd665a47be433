"""JSON: limits of size and depth, and the kinds of values."""

from pathlib import Path

import pytest

from uvcloth.errors import InputError
from uvcloth.files.json_file import MOST_DEPTH, parse_json, read_json, require_kinds


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[" * 100_000 + "]" * 100_000, "nested too deep"),
        ('{"a":' * (MOST_DEPTH + 1) + "0" + "}" * (MOST_DEPTH + 1), f"nested deeper than {MOST_DEPTH}"),
        ('{"a": 1, "a": 2}', "the key 'a' occurs twice"),
        ('{"a": 1234567890123456789012}', "a whole number of 22 digits"),
        ('{"a": "\\ud800"}', "surrogates not allowed"),
        ("[1]", "not a JSON object"),
        ("", "Expecting value"),
    ],
)
def test_what_is_no_plain_object_is_refused(text: str, said: str) -> None:
    with pytest.raises(InputError, match=f"a.json: .*, expected a thing.*{said}|a.json: {said}") as caught:
        parse_json(text, "a.json", "a thing")
    assert "\n" not in str(caught.value)


def test_a_file_with_a_byte_order_mark_is_read_and_other_encodings_are_not(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    path.write_text('{"a": [1, "ö"]}', encoding="utf-8-sig")
    assert read_json(path, "a thing") == {"a": [1, "ö"]}
    path.write_text('{"a": 1}', encoding="utf-16")
    with pytest.raises(InputError, match=r"a\.json: not a readable JSON file"):
        read_json(path, "a thing")
    with pytest.raises(InputError, match="a folder or a device"):
        read_json(tmp_path, "a thing")


KINDS = {"name": str, "size": int, "share?": float, "parts": [{"*": float}], "none?": (str, type(None))}


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({}, ""),
        ({"share": 1, "none": None}, ""),
        ({"name": 3}, "a.json, name: is 3, expected a text"),
        ({"size": True}, "a.json, size: is true, expected a whole number"),
        ({"share": float("inf")}, "a.json, share: is inf, expected a finite number"),
        ({"parts": [{"a": "x"}]}, "a.json, parts, entry 0, 'a': is \"x\", expected a number"),
        ({"parts": {}}, "a.json, parts: is {}, expected a list"),
        ({"none": 1}, "a.json, none: is 1, expected a text"),
    ],
)
def test_kinds_of_values_are_checked(change: dict, said: str) -> None:
    values = {"name": "a", "size": 1, "parts": [{"a": 1.0}], **change}
    if not said:
        require_kinds(values, KINDS, "a.json")
        return
    with pytest.raises(InputError) as caught:
        require_kinds(values, KINDS, "a.json")
    assert str(caught.value) == said


def test_a_key_that_is_missing_is_named() -> None:
    with pytest.raises(InputError, match=r"a\.json: lacks 'size'"):
        require_kinds({"name": "a", "parts": []}, KINDS, "a.json")
