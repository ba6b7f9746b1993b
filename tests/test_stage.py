"""Parameters at the door of a stage: every wrong one is refused by name, with what is wanted."""

import io
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import pytest

from pipeline import stage
from pipeline.stage import dvc_keys, knob, launch, read
from s3le.errors import ParameterError, TableError


@dataclass(frozen=True, kw_only=True)
class Params:
    section: ClassVar[str] = "sample"
    alpha: float = knob("relaxation [-]", at_least=0, at_most=10, shared=True)
    rows: int = knob("tuples to draw", at_least=1)
    mixup: bool = knob("use mixup")
    metric: str = knob("distance", one_of=("l2", "cosine"))
    weight: float = knob("weight", at_least=0)
    place: str = knob("folder")


GOOD = "alpha: 0.2\nsample:\n  rows: 5\n  mixup: true\n  metric: l2\n  weight: 3\n  place: here\n"


def given(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "params.yaml"
    path.write_text(text)
    return path


def test_good_parameters_are_read(tmp_path):
    assert read(Params, given(tmp_path, GOOD)) == Params(
        alpha=0.2, rows=5, mixup=True, metric="l2", weight=3.0, place="here"
    )


def test_an_int_serves_as_a_float_because_dvc_writes_one(tmp_path):
    alpha = read(Params, given(tmp_path, GOOD.replace("0.2", "1"))).alpha
    assert alpha == 1.0
    assert isinstance(alpha, float)


def test_1e_3_is_a_number(tmp_path):
    assert read(Params, given(tmp_path, GOOD.replace("0.2", "1e-3"))).alpha == 0.001


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("alpha: 0.2", "alpha: -1", r"alpha must be float in \[0, 10\], got -1.0"),
        ("alpha: 0.2", "alpha: .nan", r"alpha must be float in \[0, 10\], got nan"),
        ("alpha: 0.2", "alpha: abc", r"alpha must be float in \[0, 10\], got 'abc'"),
        ("alpha: 0.2", "alpha:", r"alpha must be float in \[0, 10\], got None"),
        ("alpha: 0.2", "alpah: 0.2", r"alpha is missing \(relaxation \[-\]\)"),
        ("rows: 5", "rows: 0", r"sample.rows must be int in \[1, inf\], got 0"),
        ("rows: 5", "rows: 5.5", r"sample.rows must be int in \[1, inf\], got 5.5"),
        ("rows: 5", "rows: true", r"sample.rows must be int in \[1, inf\], got True"),
        ("rows: 5", "rowz: 5", "section 'sample' has no parameter 'rowz'; did you mean rows?"),
        ("rows: 5", "rows: 5\n  zebra: 1", "no parameter 'zebra'; it has: rows, mixup, metric, w"),
        ("  mixup: true\n", "", r"sample.mixup is missing \(use mixup\)"),
        ("mixup: true", "mixup: 1", "sample.mixup must be bool, got 1"),
        ("metric: l2", "metric: cosin", "one of l2, cosine, got 'cosin'; did you mean cosine?"),
        (GOOD, "alpha: 0.2\nsample: 3\n", "must be a mapping"),
        (GOOD, "alpha: [1", "not readable as YAML"),
        (GOOD, "- 1", "expected a mapping with parameters"),
        (GOOD, "alpha: &a 1\nbeta: *a\n", r"YAML aliases \(\*name\) are not read"),
        (GOOD, "[" * 20_000, "nested deeper than 32 levels in line 1"),
        (GOOD, "#" * 40_000, "longer than the 32 KiB that are read"),
        ("alpha: 0.2", "alpha: " + "9" * 5000, r"not readable as YAML \(Exceeds the limit"),
        ("alpha: 0.2", "alpha: " + "9" * 400, r"alpha must be float in \[0, 10\], got 999"),
        ("rows: 5", "rows: 9223372036854775808", r"sample.rows must be int in \[1, inf\], got 922"),
        ("weight: 3", "weight: .inf", r"sample.weight must be float in \[0, inf\], got inf"),
        ("place: here", r'place: "a\0b"', r"sample.place must be str, got 'a\\x00b'"),
        ("place: here", "place: ''", "sample.place must be str, got ''"),
    ],
)
def test_a_wrong_parameter_is_refused_by_name(tmp_path, old, new, words):
    with pytest.raises(ParameterError, match=words.replace("?", r"\?")):
        read(Params, given(tmp_path, GOOD.replace(old, new)))


def test_a_missing_file_says_where_to_run(tmp_path):
    with pytest.raises(ParameterError, match="is missing here; run from the project's folder"):
        read(Params, tmp_path / "params.yaml")


def test_dvc_keys_are_the_shared_ones_and_the_section():
    assert dvc_keys(Params) == ["alpha", "sample"]


@pytest.fixture
def in_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["stage"])
    return tmp_path


def test_a_refusal_is_one_line_and_status_2(in_folder, capsys):
    def main() -> None:
        raise TableError("poses: no rows")

    with pytest.raises(SystemExit) as end:
        launch(main, "poses")
    assert end.value.code == 2
    assert capsys.readouterr().err == "TableError: poses: no rows\n"
    assert not stage.TIMING.exists()


def test_a_full_disk_is_one_line_and_status_2(in_folder, capsys):
    def main() -> None:
        raise OSError(28, "No space left on device")

    with pytest.raises(SystemExit) as end:
        launch(main, "poses")
    assert end.value.code == 2
    assert "No space left on device" in capsys.readouterr().err


def test_a_finished_stage_notes_its_time(in_folder):
    launch(lambda: None, "poses")
    assert '"poses"' in stage.TIMING.read_text()


# --- progress


class Terminal(io.StringIO):
    def isatty(self):
        return True


def advance(bar_of, monkeypatch, screen):
    monkeypatch.setattr(sys, "stderr", screen)
    with bar_of as progress:
        progress(400, {"rows": 400, "solved": 100, "fallback": 2})
        progress(600, {"rows": 1000, "solved": 250, "fallback": 2})
    return screen.getvalue()


def test_the_engine_s_bar_tells_rows_rate_time_left_and_how_rows_were_projected(monkeypatch):
    told = advance(stage.shards_bar(1000, "tuples"), monkeypatch, Terminal())
    assert "tuples" in told and "1.00k/1.00k" in told and "rows/s" in told
    assert "projected 25.00%, by fallback 0.20%" in told


def test_bars_are_quiet_where_nobody_looks_on(monkeypatch):
    assert advance(stage.shards_bar(1000, "tuples"), monkeypatch, io.StringIO()) == ""
