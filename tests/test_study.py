"""The study: what it plans exists, what is recorded is not made again, and its tables add up."""

import sys
from pathlib import Path

import pytest
from ruamel.yaml import YAML

ROOT = Path(__file__).parents[1]
PARAMS = YAML(typ="safe").load(ROOT / "params.yaml")


@pytest.fixture
def study(monkeypatch, tmp_path):
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks/study"))
    for name in ("run", "tables"):
        sys.modules.pop(name, None)
    import run
    import tables

    monkeypatch.setattr(run, "WORK", tmp_path)
    monkeypatch.setattr(run, "RUNS", tmp_path / "runs.csv")
    monkeypatch.setattr(tables, "REPORTS", tmp_path)
    yield run
    for name in ("run", "tables"):
        sys.modules.pop(name, None)


def rows_of(run, value=0.1):
    return [
        {key: getattr(run, key) for key in ("experiment", "row", "seed")}
        | {"method": method, "split": "heldout", "motion": motion, "frames": 10}
        | {"to_truth": value + 0.01 * k, "to_human": 0.2, "collision_rate": 0.0}
        | {"below_margin_rate": 0.0, "limit_rate": 0.0, "pool": 7, "seconds": 1, "commit": "c"}
        | {"date": "2000-01-01", "machine": "m", "changed": "{}"}
        for k, method in enumerate(run.entries)
        for motion in ("all", "a", "b")
    ]


def test_every_planned_parameter_exists(study):
    runs = list(study.planned([], {}))
    assert len({run[:3] for run in runs}) == len(runs) > 10
    for run in runs:
        for key in run.changed:
            *section, name = key.split(".")
            assert name in (PARAMS[section[0]] if section else PARAMS), key


def test_an_unknown_experiment_is_refused_by_name(study):
    with pytest.raises(SystemExit, match="no experiment 'cum'; there are: cmu"):
        list(study.planned(["cum"], {}))


def test_what_is_recorded_is_there_once(study):
    one, two, *_ = study.planned(["cmu"], {})
    assert not study.is_there(one)
    study.record(one, rows_of(one))
    study.record(two, rows_of(two))
    study.record(one, rows_of(one, 0.3))
    assert study.is_there(one) and study.is_there(two)
    table = study.recorded()
    assert len(table) == 2 * len(rows_of(one))
    assert table.filter(seed=one.seed)["to_truth"].min() == pytest.approx(0.3)


def test_the_page_counts_the_motions_that_are_won(study, tmp_path):
    import tables

    for run in study.planned(["cmu"], {}):
        study.record(run, rows_of(run))  # S3LE stands first, so it is best everywhere
    for run in list(study.planned(["ablations"], {}))[:3]:
        study.record(run, rows_of(run, 0.2))
    tables.main()
    text = (tmp_path / "study.md").read_text()
    assert "| all of them | 2 of 2, 2 of 2, 2 of 2 | 100% |" in text
    assert "| base | 0.2000 | - | 0.2100 | 0.95 | 1 |" in text
    assert (tmp_path / "cmu.png").stat().st_size > 1000
