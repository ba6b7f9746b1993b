"""docs/api.md: its signatures are the code's, its examples run, and it leaves nothing out."""

import inspect
import re
from pathlib import Path

import numpy as np
import pytest
from handmade import bvh, write

import s3le
from s3le.retarget import stored

PAGE = (Path(__file__).parents[1] / "docs" / "api.md").read_text(encoding="utf-8")
SIGNATURES = re.findall(r"`([A-Za-z_.]+)\(([^`]*)\)`", PAGE.replace("\n", " "))
WRITTEN = dict(reversed(SIGNATURES))  # the first of a name is its signature, others are calls


def in_words(given) -> str:
    """A signature without types, as the page writes it."""
    parts, keyword = [], False
    for one in inspect.signature(given).parameters.values():
        if one.name in ("self", "cls"):
            continue
        if one.kind is one.KEYWORD_ONLY and not keyword:
            parts.append("*")
            keyword = True
        star = {one.VAR_KEYWORD: "**", one.VAR_POSITIONAL: "*"}.get(one.kind, "")
        default = "" if one.default is one.empty else f"={one.default!r}"
        parts.append(f"{star}{one.name}{default}")
    return ", ".join(parts)


def test_every_name_has_a_section_and_no_other():
    assert set(re.findall(r"^## (\w+)$", PAGE, re.M)) == set(s3le.__all__) - {"__version__"}


@pytest.mark.parametrize(
    "name",
    ["Guard.load", "Guard.start", "Guard.step", "Guard.chunk", "Robot.load", "Retargeter.load",
     "Retargeter.start", "audit", "read_clip", "retarget_clip", "retargeter_for"],
)  # fmt: skip
def test_a_signature_on_the_page_is_the_code_s(name):
    found = s3le
    for part in name.split("."):
        found = getattr(found, part)
    assert WRITTEN[name] == in_words(found)
    assert found.__doc__


def test_the_examples_run(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(stored, "ROWS", 400)
    monkeypatch.chdir(tmp_path)
    rows = [[0, 0, 0, 0, 0, 0, -40 * np.sin(k / 8), 0, 0, 0, 0, 0] for k in range(30)]
    write(tmp_path / "walk.bvh", bvh(rows, order="ZXY", step=f"{1 / 30:.9f}"))
    names: dict = {}
    for block in re.findall(r"```python\n(.*?)```", PAGE, re.S):
        exec(compile(block, "docs/api.md", "exec"), names)
    assert "walk" in capsys.readouterr().out and names["report"].holds


def test_what_is_handed_out_is_loaded_when_it_is_asked_for():
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = s3le.nothing
    assert set(s3le.__all__) <= set(dir(s3le))
    assert re.fullmatch(r"\d+\.\d+\.\d+", s3le.__version__)
