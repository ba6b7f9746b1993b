"""The numbers that runs are compared by: few, the headline first, none of them invented."""

import json
from pathlib import Path

import pytest
from dvc.utils.flatten import flatten

from s3le.learn.methods import ENTRIES
from s3le.study import metrics

ROOT = Path(__file__).parents[1]


@pytest.fixture
def run():
    return json.loads((ROOT / "reports/run.json").read_text(encoding="utf-8"))


def test_two_to_three_dozen_numbers_with_the_headline_first(run):
    flat = flatten(metrics.compared(run))
    assert 20 <= len(flat) <= 36
    assert all(isinstance(value, (int, float)) for value in flat.values())
    answer = run["splits"]["test"]["methods"]["certified_refined"]
    assert flat["answer.test.to_truth"] == answer["to_truth"]
    assert [key.split(".")[0] for key in sorted(flat)[:4]] == ["answer"] * 4  # as dvc sorts


def test_every_row_of_the_comparison_is_there_once(run):
    for split, part in run["splits"].items():
        part["methods"] = {name: dict(part["methods"]["s3le"], to_truth=k / 100)
                           for k, name in enumerate(ENTRIES)}  # fmt: skip
        found = metrics.compared(run)
        told = found["distance"][split] | {"certified_refined": found["answer"][split]["to_truth"]}
        for k, name in enumerate(ENTRIES):
            assert told[name] == k / 100


def test_what_is_recorded_is_what_the_run_says(run):
    kept = json.loads((ROOT / "reports/metrics.json").read_text(encoding="utf-8"))
    assert kept == metrics.compared(run)
