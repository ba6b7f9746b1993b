"""Profiles: every key exists, every value can be read, every departure is a row of the readings."""

import re
import sys
from pathlib import Path

import pytest
from ruamel.yaml import YAML

from pipeline import coverage, index, pair, poses, sample, skeletons, stage, synthetic, train

ROOT = Path(__file__).parents[1]
PARAMS = YAML(typ="safe").load(ROOT / "params.yaml")
READERS = [
    *(part.Params for part in (skeletons, pair, sample, poses, coverage, index, synthetic, train)),
    *train.METHODS.values(),
]


@pytest.fixture
def profiles(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks/study"))
    sys.modules.pop("by_profile", None)
    import by_profile

    yield by_profile
    sys.modules.pop("by_profile", None)


def default(key):
    *section, name = key.split(".")
    return PARAMS[section[0]][name] if section else PARAMS[key]


def test_every_key_of_the_papers_profile_exists_and_has_a_value_that_is_read(profiles, tmp_path):
    changed = profiles.changes("paper")
    tree = YAML(typ="safe").load(ROOT / "params.yaml")
    for key, value in changed.items():
        assert type(value) is type(default(key)), key
        *section, name = key.split(".")
        (tree[section[0]] if section else tree)[name] = value
    path = tmp_path / "params.yaml"
    YAML().dump(tree, path)
    read = {}
    for params in READERS:
        for name, value in vars(stage.read(params, path)).items():
            read[f"{params.section}.{name}"] = read[name] = value
    for key, value in changed.items():
        assert read[key] == value, key


def test_the_papers_profile_is_what_is_printed(profiles):
    changed = profiles.changes("paper")
    rates = [key for key in changed if key.endswith("_rate")]
    assert len(rates) == 5 and {changed[key] for key in rates} == {1e-3}
    assert {changed[key] for key in changed if key.endswith("consensus_kind")} == {"plain"}
    assert changed["tau"] == changed["beta"] == changed["synthetic.tau"] == 1.0
    assert (changed["sample.sampler"], changed["projection"]) == ("uniform", "blend")
    assert changed["lwl2.mixup"] is False and changed["s3le.mixup"] is True
    assert {changed[key] for key in changed if ".weight_" in key} == {1.0}


def test_every_departure_of_the_default_is_a_row_of_the_readings(profiles):
    text = (ROOT / "docs/readings.md").read_text(encoding="utf-8")
    rows = [line for line in text.splitlines() if line.startswith("|")]
    named = {key.split(":")[0] for row in rows for key in re.findall(r"`([^`]+)`", row)}
    departs = [key for key, value in profiles.changes("paper").items() if default(key) != value]
    assert len(departs) > 25
    assert [key for key in departs if key not in named] == []


def test_a_profile_or_key_that_is_not_there_is_refused_by_name(profiles, monkeypatch, tmp_path):
    for name in ("papers", "../paper", "../params"):
        with pytest.raises(SystemExit, match="no profile .*; there are: paper"):
            profiles.changes(name)
    (tmp_path / "odd.yaml").write_text("train.rate: 1\n")
    monkeypatch.setattr(profiles, "PROFILES", tmp_path)
    with pytest.raises(SystemExit, match=r"odd.yaml: params.yaml has no train.rate"):
        profiles.changes("odd")


def test_a_profile_becomes_words_that_dvc_reads(profiles):
    words = profiles.overrides({"tau": 1.0, "s3le.mixup": False, "projection": "blend"})
    assert words == ["-S", "tau=1.0", "-S", "s3le.mixup=false", "-S", "projection=blend"]
