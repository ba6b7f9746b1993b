"""docs/parameters.md against dvc.yaml, and dvc's own word on what a changed key makes stale."""

import re
import shutil
import subprocess

import pytest
from dag import ROOT, readers_and_reruns
from ruamel.yaml import YAML

PARAMS = YAML(typ="safe").load(ROOT / "params.yaml")


@pytest.fixture(scope="module")
def promised():
    return readers_and_reruns(ROOT)


def table():
    rows = {}
    for line in (ROOT / "docs" / "parameters.md").read_text(encoding="utf-8").splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if len(cells) == 3 and cells[0].startswith("`"):
            for key in re.findall(r"`([^`]+)`", cells[0]):
                rows[key] = cells[1], cells[2]
    return rows


def spelt_out(cell, stages):
    """`train@s3le/ale, index (all)` -> stage names."""
    out = set()
    for part in cell.split(", "):
        if part.endswith(" (all)"):
            base = part.removesuffix(" (all)")
            out |= {stage for stage in stages if stage.startswith(f"{base}@")}
        elif "@" in part:
            base, items = part.split("@")
            out |= {f"{base}@{item}" for item in items.split("/")}
        else:
            out.add(part)
    return out


def keys():
    for name, value in PARAMS.items():
        yield from ([f"{name}.{own}" for own in value] if isinstance(value, dict) else [name])


@pytest.mark.parametrize("key", list(keys()))
def test_the_table_says_what_dvc_yaml_says(key, promised):
    reads, reruns = promised[key.split(".")[0]]
    everything = set().union(*(stages for _, stages in promised.values()))
    cells = table()[key]
    assert spelt_out(cells[0], everything) == reads
    assert spelt_out(cells[1], everything) == reruns


def test_alpha_and_tau_rerun_what_the_paper_says_depends_on_them(promised):
    assert promised["alpha"][1] == {
        "sample", "coverage", "train@s3le", "index@lwl2_all", "index@s3le", "index@skeleton_all",
        "evaluate@lwl2_all", "evaluate@s3le", "evaluate@skeleton_all", "grid", "metrics",
        "report", "export",
        "evaluate@certified_lookup", "evaluate@certified_refined",
    }  # fmt: skip
    assert promised["tau"][1] == {
        "train@s3le", "index@s3le", "evaluate@s3le", "grid", "metrics", "report", "export",
        "evaluate@certified_lookup", "evaluate@certified_refined",
    }  # fmt: skip


def test_how_it_is_exported_touches_the_certified_rows_alone(promised):
    assert promised["export"][1] == {
        "export", "evaluate@certified_lookup", "evaluate@certified_refined", "metrics", "report",
    }  # fmt: skip


@pytest.mark.parametrize("command", [["dag", "--dot"], ["stage", "list"], ["params", "diff"]])
def test_dvc_understands_the_project(command):
    done = subprocess.run(
        [shutil.which("dvc"), *command], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
