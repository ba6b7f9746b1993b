import csv
from pathlib import Path

import pytest
from handmade import SHARED, table

from s3le.errors import ClipError, FetchError
from s3le.human import manifest, sources

CLIPS = Path(__file__).parents[1] / "data" / "clips"
COLUMNS = "trial,description,fps,split,sha256,asf_sha256"


@pytest.mark.parametrize(
    ("row", "why"),
    [
        (("../../x", "d", 120, "train", "", ""), r":3: '../../x' is no name of a clip"),
        (("01_01", "d", 120, "train", "", ""), ":3: '01_01' is there twice"),
        (("01_02", "d", 120, "training", "", ""), ":3: split must be one of train, test"),
        (("01_02", "d", 120, "train", "beef", ""), ":3: 'beef' is no sha256"),
        (("a" * 101, "d", 120, "train", "", ""), "'a+...' is no name of a clip"),
        (("01_02", "d\0", 120, "train", "", ""), r":3: an unprintable character in 'd\\x00'"),
        (("01_02", "d\ne", 120, "train", "", ""), r": an unprintable character in 'd\\ne'"),
        (("01_02", "d", 120, "train", ""), ":3: a row has 6 values"),
        (("01_02", "d", 120, "train", "", "", ""), ":3: a row has 6 values"),
    ],
)
def test_a_faulty_manifest_is_refused_with_its_line(tmp_path, row, why):
    path = table(tmp_path / "m.csv", COLUMNS, ("01_01", "d", 120, "train", "", ""), row)
    with pytest.raises(ClipError, match=why):
        sources.cmu(path, tmp_path / "c", tmp_path)


@pytest.mark.parametrize(
    "fps",
    ["", "nan", "inf", "1_20", " 120", "\u0661\u0662\u0660", "0x78", "1e9", "9" * 5000, "-120"],
)
def test_a_rate_that_is_no_plain_number_is_refused_in_a_short_line(fps):
    with pytest.raises(ClipError, match="m.csv: fps of 01_02 must be a frame rate, got") as refusal:
        manifest.rate(Path("m.csv"), "01_02", fps)
    assert len(str(refusal.value)) < 150
    assert manifest.rate(Path("m.csv"), "01_02", "119.88") == 119.88


def test_a_list_may_end_without_a_newline_but_not_within_a_row(tmp_path):
    columns = tuple(COLUMNS.split(","))
    row = ("01_01", "d", 120, "train", "ab" * 32, "cd" * 32)
    text = table(tmp_path / "m.csv", COLUMNS, row).read_text().rstrip("\r\n")
    path = tmp_path / "cut.csv"
    path.write_text(text)
    assert manifest.manifest(path, columns)[0] == dict(zip(columns, map(str, row), strict=True))
    for lost, why in ((1, "no asf_sha256"), (30, "no asf_sha256"), (65, "a row has 6 values")):
        path.write_text(text[:-lost])
        with pytest.raises(ClipError, match=f"cut.csv:2: .*{why}"):
            manifest.manifest(path, columns)


def test_a_trial_says_whether_it_is_certain_or_inferred(tmp_path):
    columns, base = f"{COLUMNS},identity", ("d", 120, "test", "", "")
    for who in ("", "certain", "inferred"):
        path = table(tmp_path / "m.csv", columns, ("01_01", *base, who))
        found = manifest.manifest(path, tuple(COLUMNS.split(",")), ("identity",))
        assert found[0]["identity"] == who
    for row, why in ((("01_01", *base, "sure"), "identity must be empty, certain or inferred"),
                     (("01_01", *base), "a row has 7 values")):  # fmt: skip
        path = table(tmp_path / "m.csv", columns, row)
        with pytest.raises(ClipError, match=f":2: {why}"):
            sources.cmu(path, tmp_path / "c", tmp_path)


def test_the_authors_trials_are_all_called_certain_or_inferred():
    rows = list(csv.DictReader((CLIPS / "cmu" / "manifest.csv").read_text().splitlines()))
    named = {r["trial"]: r["identity"] for r in rows if r["identity"]}
    assert named.keys() == {r["trial"] for r in rows if r["split"] == "test"}
    # Their list counts files; the counts are complete up to subject 62 and not beyond.
    assert all((who == "certain") == (int(t.split("_")[0]) < 63) for t, who in named.items())
    assert list(named.values()).count("certain") == 16


def test_other_columns_are_refused(tmp_path):
    path = table(tmp_path / "m.csv", "trial,fps", ("01_01", 120))
    with pytest.raises(ClipError, match="m.csv:1: columns must be trial,description,fps"):
        sources.cmu(path, tmp_path / "c", tmp_path)


def test_the_projects_lists_hold_the_clips_they_promise(tmp_path):
    rows = list(csv.DictReader((CLIPS / "cmu" / "manifest.csv").read_text().splitlines()))
    count = {split: sum(r["split"] == split for r in rows) for split in sources.SPLITS}
    assert count == {"train": 10, "test": 27, "heldout": 17}
    assert {r["trial"]: r["fps"] for r in rows}["79_51"] == "60"
    rows = list(csv.DictReader((CLIPS / "demo" / "manifest.csv").read_text().splitlines()))
    assert [sum(r["split"] == s for r in rows) for s in ("train", "test")] == [10, 5]
    with pytest.raises(FetchError, match="54 of 54 trials cannot be had"):
        sources.cmu(CLIPS / "cmu" / "manifest.csv", tmp_path, tmp_path)


@pytest.mark.skipif(not SHARED.is_dir(), reason="needs the real clips beside the project")
def test_the_projects_training_trials_are_the_files_listed(tmp_path):
    listed = CLIPS / "cmu" / "manifest.csv"
    found = sources.cmu(listed, tmp_path, SHARED / "cmu", splits=("train", "heldout"))
    assert len(found.clips) == 27 and found.left_out == []
