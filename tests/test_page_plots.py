"""What dvc makes of the plots of two runs."""

import json
import subprocess
import sys
from pathlib import Path

from paged import ROOT
from ruamel.yaml import YAML


def test_dvc_plots_diff_shows_every_chart_of_two_runs(tmp_path):
    """The project's own plots on the project's own files, which differ between two commits."""
    plots = YAML(typ="safe").load(ROOT / "dvc.yaml")["plots"]
    YAML().dump({"plots": plots}, tmp_path / "dvc.yaml")
    files = named(plots)

    def good(*command: str) -> tuple[str, str]:
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout, done.stderr

    for file in files:
        (tmp_path / file).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / file).write_bytes((ROOT / file).read_bytes())
    git = ("git", "-c", "user.name=t", "-c", "user.email=t@t", "-c", "commit.gpgsign=false")
    good("git", "init", "-q")
    dvc = str(Path(sys.executable).with_name("dvc"))
    good(dvc, "init", "-q")
    good("git", "add", "-A")
    good(*git, "commit", "-qm", "one")
    for file in files:
        if file.endswith(".csv"):
            lines = (tmp_path / file).read_text().splitlines()
            (tmp_path / file).write_text("\n".join(lines[:-1]) + "\n")
    good("git", "add", "-A")
    good(*git, "commit", "-qm", "two")
    shown, warned = good(dvc, "plots", "diff", "HEAD~1", "HEAD", "--json")
    assert "WARNING" not in warned and "failed" not in warned
    found = json.loads(shown)["data"]
    assert found.keys() == {p if isinstance(p, str) else next(iter(p)) for p in plots}
    for name, versions in found.items():
        if versions[0]["type"] == "vega":
            revisions = {row["rev"] for row in versions[0]["content"]["data"]["values"]}
            assert len(revisions) == 2, name
        else:
            assert len(versions) == 2, name


def named(plots) -> set[str]:
    """Files that the plots are of."""
    found = set()
    for plot in plots:
        if isinstance(plot, str):
            found.add(plot)
            continue
        for how in plot.values():
            for axis in ("x", "y"):
                found |= set(how[axis]) if isinstance(how[axis], dict) else set()
    return found
