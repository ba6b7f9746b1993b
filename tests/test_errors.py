"""Refusals are one line, whatever a file has put into them."""

import pickle

import pytest

from s3le.errors import LONGEST, ClipError, S3leError


@pytest.mark.parametrize(
    ("text", "seen"),
    [
        ("a.bvh:3: why, what next", "a.bvh:3: why, what next"),
        ("one\ntwo\r\nthree", r"one\ntwo\r\nthree"),
        ("\0\x1b[31m\u2028\u202e\udcff", r"\x00\x1b[31m\u2028\u202e\udcff"),
        ("M\u00fcller/\u8d70.bvh: no", "M\u00fcller/\u8d70.bvh: no"),
    ],
    ids=["plain", "lines", "controls", "letters"],
)
def test_a_refusal_is_one_printable_line(text, seen):
    assert str(ClipError(text)) == seen
    assert str(pickle.loads(pickle.dumps(ClipError(text)))) == seen


@pytest.mark.parametrize("character", ["x", "\0", "\U000e0001"], ids=["x", "nul", "tag"])
def test_a_long_refusal_keeps_its_beginning_and_its_end(character):
    told = str(S3leError("file: " + character * 10**6 + " what next"))
    assert len(told) == LONGEST and told.isprintable()
    assert told.startswith("file: ") and " ... " in told and told.endswith(" what next")
