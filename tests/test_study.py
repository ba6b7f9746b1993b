"""The study: what it plans exists, what is recorded is not made again, and its tables add up."""

import csv
import sys
from pathlib import Path

import pytest
from ruamel.yaml import YAML

ROOT = Path(__file__).parents[1]
PARAMS = YAML(typ="safe").load(ROOT / "params.yaml")


MODULES = ("run", "tables", "search", "by_profile")
C, OTHER = "c" * 12, "d" * 12  # commits


@pytest.fixture
def study(monkeypatch, tmp_path):
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks/study"))
    for name in MODULES:
        sys.modules.pop(name, None)
    import run
    import search
    import tables

    monkeypatch.setattr(run, "WORK", tmp_path)
    monkeypatch.setattr(run, "RUNS", tmp_path / "runs.csv")
    monkeypatch.setattr(search, "FOUND", tmp_path / "search.csv")
    monkeypatch.setattr(tables, "REPORTS", tmp_path)
    yield run
    for name in MODULES:
        sys.modules.pop(name, None)


def rows_of(run, value=0.1, commit=C):
    cells = ["skeleton/all/l2", "s3le/pairs/l2", "s3le/pairs/l1"] if run.grid else []
    return [
        {key: getattr(run, key) for key in ("experiment", "row", "seed")}
        | {"method": method, "split": "heldout", "motion": motion, "frames": 10}
        | {"to_truth": value + 0.01 * k, "to_human": 0.2, "collision_rate": 0.0}
        | {"below_margin_rate": 0.0, "limit_rate": 0.0, "pool": 7, "seconds": 1, "commit": commit}
        | {"date": "2000-01-01", "machine": "m", "changed": run.told()}
        for k, method in enumerate([*run.entries, *cells])
        for motion in (("all",) if method in cells else ("all", "14_05", "29_07"))
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


def test_a_seed_moves_data_and_start_and_a_profile_is_the_ground(study):
    paper = list(study.planned(["paper"], {"clips_mirror": "/x"}))
    seeds = [(run.changed["seed"], run.changed["train.seed"]) for run in paper]
    assert seeds == [(1, 1), (2, 2), (3, 3)]
    assert paper[0].changed["s3le.adversary_rate"] == 0.001 and paper[0].grid
    assert "lwl2_all" in paper[0].entries and "/x" not in paper[0].told()
    given = next(study.planned(["paper"], {"tau": 0.3})).changed
    assert given["tau"] == 0.3 and given["projection"] == "blend"  # what is asked for goes first
    ablated = study.planned(["ablations"], {"s3le.mixup": True})
    assert {run.changed["s3le.mixup"] for run in ablated if run.row == "no mixup"} == {False}


def test_what_is_recorded_is_there_once(study):
    one, two, *_ = study.planned(["cmu"], {})
    assert not study.is_there(one, C)
    study.record(one, rows_of(one))
    study.record(two, rows_of(two))
    study.record(one, rows_of(one, 0.3))
    assert study.is_there(one, C) and study.is_there(two, C)
    table = study.recorded()
    assert len(table) == 2 * len(rows_of(one))
    assert table.filter(seed=one.seed)["to_truth"].min() == pytest.approx(0.3)


def test_rows_of_another_commit_or_of_other_parameters_are_made_anew(study):
    one = next(study.planned(["cmu"], {}))
    study.record(one, rows_of(one, commit=OTHER))
    assert study.is_there(one, OTHER + "0" * 28) and not study.is_there(one, C)
    study.record(one, rows_of(one))
    assert study.is_there(one, C) and not study.is_there(one, OTHER)
    assert not study.is_there(one._replace(changed=one.changed | {"tau": 0.5}), C)
    assert study.is_there(next(study.planned(["cmu"], {"clips_mirror": "/elsewhere"})), C)
    ungridded = [row for row in rows_of(one) if "/" not in row["method"]]
    study.record(one, ungridded)
    assert not study.is_there(one, C)


def test_the_page_counts_the_motions_that_are_won(study, tmp_path):
    import tables

    for run in study.planned(["cmu"], {}):
        study.record(run, rows_of(run))  # S3LE stands first, so it is best everywhere
    short = list(study.planned(["ablations"], {}))
    for run in short[:3] + [r for r in short if r.seed == 2][:2]:
        study.record(run, rows_of(run, 0.2))
    tables.main()
    text = (tmp_path / "study.md").read_text()
    assert "| all of them | 2 of 2, 2 of 2, 2 of 2 | 100% | 3 |" in text
    assert "2 motions of 2 people (CMU's subjects 14, 29), 10 frames" in text
    assert "In the mean over all frames S3LE (0.1000) is below ALE (0.1400)" in text
    assert "| nearest skeleton, all | 7 | 0.1800 ± 0.0000 | - | 3 |" in text
    assert "| S3LE, pairs | 7 | 0.1900 ± 0.0000 | 0.2000 ± 0.0000 | 3 |" in text
    # two seeds of the first two rows, one of the third
    assert "| base | 0.2000 ± 0.0000 | - | 0.2100 | 0.95 | 2 |" in text
    assert "| no NT-Xent | 0.2000 ± 0.0000 | +0.0000 ± 0.0000 | 0.2100 | 0.95 | 2 |" in text
    assert "| no mixup |" not in text and "left out: no mixup; no sampled tuples." in text
    assert "†" not in text
    assert (tmp_path / "cmu.png").stat().st_size > 1000


def test_s3le_is_said_to_be_behind_where_it_is(study, tmp_path):
    import tables

    for run in study.planned(["uniform"], {}):
        rows = rows_of(run)
        for row in rows:
            if row["method"] == "ale":
                row["to_truth"] = 0.05 if row["motion"] == "14_05" else 0.09
        study.record(run, rows)
    tables.main()
    text = (tmp_path / "study.md").read_text()
    assert "S3LE (0.1000) is behind ALE (0.0900)" in text
    assert "| ALE (decoder) | 0 of 2, 0 of 2, 0 of 2 | 0% | 3 |" in text
    assert "Brute force" not in text  # it is not nearer in these rows


def test_a_row_of_another_commit_is_marked_and_the_table_names_its_own(study, tmp_path):
    import tables

    for run in study.planned(["cmu"], {}):
        rows = rows_of(run, commit=C)
        for row in rows:
            if run.seed == 2 and row["method"] == "lwl2":
                row["commit"] = OTHER
        study.record(run, rows)
    tables.main()
    text = (tmp_path / "study.md").read_text()
    assert f"3 of 3 trainings; commit {C};" in text
    assert f"† has trainings of another commit: default, seed 2: {OTHER} (lwl2)." in text
    marked = {line.split("|")[1].strip() for line in text.splitlines() if line.startswith("|")
              and "†" in line}  # fmt: skip
    assert marked == {"LWL2, pairs and robot poses †"}


# --- the search of settings


def test_every_method_has_the_same_budget_its_default_first(study):
    import search

    assert len({len(space) for space in search.SPACE.values()}) == 1
    runs = list(search.planned(5, 70, 1, "cmu", {}))
    for method in search.SPACE:
        own = [run for run in runs if run.experiment == method]
        assert len(own) == 5 and {run.changed[f"{method}.steps"] for run in own} == {70}
        fewer = search.settings(method, 3, 1)
        assert fewer == search.settings(method, 5, 1)[:3] and fewer[0] == {}
        assert search.settings(method, 3, 2)[1:] != fewer[1:]
    assert [run.experiment for run in runs[:4]] == ["s3le", "lwl2", "ale", "s3le"]  # in turns


def test_every_setting_that_can_be_drawn_is_one_that_a_stage_reads(study, tmp_path):
    import search

    from pipeline import index, stage, train

    for method in search.SPACE:
        for setting in search.settings(method, 12, 3):
            tree = YAML(typ="safe").load(ROOT / "params.yaml")
            for key, value in setting.items():
                *section, name = key.split(".")
                home = tree[section[0]] if section else tree
                assert name in home, key
                home[name] = value
            YAML().dump(tree, tmp_path / "params.yaml")
            for params in (train.Params, train.METHODS[method], index.Params):
                stage.read(params, tmp_path / "params.yaml")


@pytest.mark.parametrize("clips", ["cmu", "demo"])
def test_the_validation_set_is_split_off_the_training_clips(study, clips):
    import search

    listed = (ROOT / "data/clips" / clips / "manifest.csv").read_text()
    before = list(csv.DictReader(listed.splitlines()))
    after = list(csv.DictReader(search.split_off(listed, search.VALIDATION[clips]).splitlines()))
    name = next(iter(before[0]))
    assert {row[name] for row in after} == {r[name] for r in before if r["split"] == "train"}
    validating = {row[name] for row in after if row["split"] == "test"}
    assert validating == set(search.VALIDATION[clips])
    if clips == "cmu":  # nobody who validates trains
        train, test = (
            {row[name].split("_")[0] for row in after if row["split"] == split}
            for split in ("train", "test")
        )
        assert not train & test
    with pytest.raises(SystemExit, match="no training clip nobody"):
        search.split_off(listed, ("nobody",))


def found_rows(run, value):
    import search

    rows = [
        {"experiment": run.experiment, "row": run.row, "seed": run.seed, "method": entry}
        | {"split": "test", "motion": motion, "frames": 5, "to_truth": value + 0.01 * k}
        | {"to_human": 0.1, "collision_rate": 0.0, "changed": run.told(), "seconds": 1}
        | {"commit": C, "date": "2000-01-01", "machine": "m"}
        for k, entry in enumerate(run.entries)
        for motion in ("all", "a")
    ]
    return search.rows_of(run, rows, {"tau": 0.5} if run.row == "1" else {})


def test_the_search_resumes_and_compares_at_equal_budget(study, tmp_path):
    import search
    import tables

    runs = list(search.planned(4, 70, 1, "cmu", {}))
    assert tables.best(tables.searched(search.FOUND)) == []
    for run, value in zip(runs[:7], (0.3, 0.3, 0.3, 0.2, 0.25, 0.31, 0.1), strict=True):
        assert not search.is_there(run, C)
        search.record(found_rows(run, value))
        assert search.is_there(run, C) and not search.is_there(run, OTHER)
    best = tables.best(tables.searched(search.FOUND))
    # S3LE's third setting (0.1) does not count: the others have had two
    assert [(b.method, b.number, b.to_truth, b.among) for b in best] == [
        ("s3le", 1, 0.2, 2), ("lwl2", 1, 0.25, 2), ("ale", 0, 0.3, 2)
    ]  # fmt: skip
    assert best[1].entry == "lwl2_pairs" and len(best[1].entries) == 3
    lines = search.standing(runs, C)
    assert lines[0].startswith("s3le    3 of 4 settings tried; best of 2: 0.2000 (s3le, no. 1)")
    search.record(found_rows(runs[3], 0.4))  # the same again: in place of the old one
    assert tables.best(tables.searched(search.FOUND))[0].number == 0
    rows = list(study.planned(["searched"], {}))
    assert len(rows) == 9 and {run.row for run in rows} == {"s3le 0", "lwl2 1", "ale 0"}
    one = next(run for run in rows if run.row == "lwl2 1")
    assert one.changed["tau"] == 0.5 and "lwl2.steps" not in one.changed  # trained in full
    for run in study.planned(["cmu"], {}):
        study.record(run, rows_of(run))
    tables.main()
    text = (tmp_path / "study.md").read_text()
    assert "| LWL2 | 0.3000 | 0.2500 | LWL2, mocap pairs | tau 0.5 | 2 |" in text
    assert "5 frames, 70 steps a setting, n settings of each; commit " + C in text
