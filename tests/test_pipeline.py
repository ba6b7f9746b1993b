"""The pipeline itself, run by dvc on a tiny configuration in a folder of its own (see tiny)."""

import json
import random
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path

import handmade
import psutil
import pytest
from dag import readers_and_reruns
from dvc.dependency import param
from dvc.repo import Repo
from ruamel.yaml import YAML
from stages import run, stale, stopped
from tiny import after_kills, environment, good, mend, ran, set_params, shell, swing

from s3le.kernels import compiled
from s3le.learn.methods import ENTRIES
from s3le.store import documents
from s3le.study import metrics

pytestmark = pytest.mark.slow
WIDE = pytest.mark.wide
ONE_AFTER_ANOTHER = """
import runpy, sys
for stage in sys.argv[1:]:
    sys.argv = [stage]
    runpy.run_module(f"pipeline.{stage}", run_name="__main__")
"""


def hashes(folder: Path) -> set[str]:
    """Hashes of the shards that the table of tuples is made of."""
    manifest = json.loads((folder / "data/kinematic_pairs/manifest.json").read_text())
    return {shard["sha256"] for shard in manifest["shards"]}


def table(folder: Path) -> dict[str, bytes]:
    return {p.name: p.read_bytes() for p in (folder / "data" / "kinematic_pairs").iterdir()}


def test_a_second_run_does_nothing(project):
    assert ran(good(project, "dvc", "repro")) == set()
    assert "up to date" in good(project, "dvc", "status")


def test_copies_of_the_project_share_what_one_of_them_has_compiled(project):
    store = Path(environment(project)["NUMBA_CACHE_DIR"]) / f"kernels-{compiled.key()}"
    assert list(store.glob("batch._project-*.nbi"))
    assert not list(project.rglob("*.nb[ic]"))


def test_every_key_makes_stale_just_the_stages_that_read_it(project, monkeypatch):
    """One process, one key at a time: dvc's own status against what dvc.yaml declares.

    Nothing is stale before (above), so the state of a stage's parameters is the state of the
    stage; that of all other dependencies, which no key can change, is looked at once at the end.
    """
    path = project / "params.yaml"
    before = path.read_text(encoding="utf-8")
    promised = readers_and_reruns(project)
    tree = YAML(typ="safe").load(before)
    keys = [
        (name, own)
        for name, value in tree.items()
        for own in (value if isinstance(value, dict) else [None])
        if name not in ("robot", "clips")  # they name files too; tested by running them
    ]
    load, parsed = param.load_path, {}

    def load_once(file, fs):  # every stage asks for the same file
        text = Path(file).read_text(encoding="utf-8")
        if text not in parsed:  # JSON is YAML that is read in no time
            parsed[text] = json.loads(text) if text.startswith("{") else load(file, fs)
        return parsed[text]

    monkeypatch.setattr(param, "load_path", load_once)
    monkeypatch.chdir(project)
    try:
        with Repo(".") as repo:
            stages = list(repo.index.stages)
            for name, own in keys:
                new = other(tree, name, own)[name]
                new = tree[name] | new if own is not None else new
                path.write_text(json.dumps(tree | {name: new}), encoding="utf-8")
                changed = {s.name for s in stages if any(d.status() for d in s.params)}
                assert changed == promised[name][0], f"{name}.{own}"
        path.write_text(before, encoding="utf-8")
        for name, own in keys:
            set_params(project, other(tree, name, own))
        with Repo(".") as repo:
            changed = {
                stage
                for stage, why in repo.status().items()
                if any("changed deps" in reason for reason in why)
            }
        assert changed == set.union(*(promised[name][0] for name, _ in keys))
    finally:
        path.write_text(before, encoding="utf-8")


def other(tree: dict, name: str, own: str | None) -> dict:
    """A key with another value, as set_params takes it."""
    old = tree[name] if own is None else tree[name][own]
    new = (not old) if isinstance(old, bool) else old + 1 if type(old) in (int, float) else "x"
    return {name: new if own is None else {own: new}}


def test_another_parameter_makes_new_rows_and_reruns_what_reads_them_and_no_more(here):
    """That every key reaches just its readers is shown without running above."""
    before = hashes(here)
    set_params(here, {"alpha": 0.5})
    output = good(here, "dvc", "repro", "index@skeleton_all")
    assert ran(output) == {"sample", "index@skeleton_all"}
    assert not before & hashes(here)  # no old row among the new ones
    table = here / "reports" / "metrics.json"
    table.write_text(re.sub(r"(0\.\d*)[1-9]", r"\g<1>0", table.read_text()))  # all of them fall
    one_screen(good(here, "dvc", "metrics", "diff"))


def one_screen(diff: str) -> None:
    """Two runs beside each other, the headline first."""
    lines = diff.strip().splitlines()
    assert 2 < len(lines) <= 24, diff
    assert "answer.test." in lines[1] or "answer.test." in lines[2], diff


@WIDE
def test_a_changed_parameter_reruns_what_it_affects_to_the_page_and_no_more(here):
    """The same as an experiment, on all stages."""
    change, reruns = (
        "alpha=0.5",
        (
            "sample coverage train@s3le index@s3le index@lwl2_all index@skeleton_all evaluate@s3le "
            "evaluate@lwl2_all evaluate@skeleton_all grid metrics report"
        ),
    )
    before = hashes(here)
    output = good(here, "dvc", "exp", "run", "-S", change)
    wanted = set(reruns.split())
    most = readers_and_reruns(here)[change.split("=")[0].split(".")[0]][1]
    assert wanted <= ran(output) <= most
    assert not before & hashes(here)  # no old row among the new ones
    diff = good(here, "dvc", "metrics", "diff")
    one_screen(diff)
    assert "tuples.moved_mean_rad" in diff


def test_what_is_made_before_training_is_the_same_to_the_byte(here):
    names = ["mocap_points", "skeletons", "mocap_domain", "mocap_pairs", "ground_truth"]
    files = [here / "data" / f"{name}.parquet" for name in names]
    for table in ("kinematic_pairs", "robot_poses"):
        files += sorted((here / "data" / table).iterdir())
    before = [file.read_bytes() for file in files]
    shutil.rmtree(here / "data" / "shards")
    one_core = ["taskset", "-c", "0"] if shutil.which("taskset") else []
    stages = ("clips", "skeletons", "pair", "sample", "poses", "truth")
    good(here, *one_core, sys.executable, "-c", ONE_AFTER_ANOTHER, *stages)
    assert [file.read_bytes() for file in files] == before


def test_metrics_are_what_a_dvc_user_expects(project):
    shown = good(project, "dvc", "metrics", "show", "--json")
    few = json.loads(shown)[""]["data"]
    assert few.keys() == {"reports/metrics.json"}
    tree = json.loads((project / "reports/run.json").read_text(encoding="utf-8"))
    assert few["reports/metrics.json"]["data"] == metrics.compared(tree)
    methods = tree["splits"]["test"]["methods"]
    assert methods.keys() == ENTRIES.keys()
    grid = documents.read_csv(project / "reports/grid.csv", "grid")
    for name, pool in (("lwl2_pairs", "pairs"), ("lwl2", "poses"), ("lwl2_all", "all")):
        at = {"split": "test", "model": "lwl2", "pool": pool, "metric": "l2"}
        cell = next(row for row in grid if at.items() <= row.items())
        assert cell["to_truth"] == pytest.approx(methods[name]["to_truth"], abs=1e-12)
    for name, found in methods.items():
        if name != "ale":
            assert found["collision_rate"] == found["limit_rate"] == 0.0
        assert found["segments"] > 0 and found["largest_jump_rad"] > 0.0
        if name.startswith("certified"):
            assert found["segment_uncertified_rate"] == found["segment_too_fast_rate"] == 0.0
    assert {"certified_lookup", "certified_refined"} <= methods.keys()
    page = (project / "reports/report.html").read_text(encoding="utf-8")
    assert ">S3LE + refine + certify</th>" in page and ">a video</h2>" in page
    assert tree["splits"]["test"]["truth"]["collision_rate"] == 0.0
    assert "seconds" not in json.dumps(tree)
    assert "WARNING" not in good(project, "dvc", "plots", "show")
    good(project, "dvc", "dag")
    assert "reports/metrics.json" in good(project, "git", "ls-files", "reports")


def cut_short(folder: Path) -> None:
    (folder / "data/clips/mine/test/swing_2.txt").write_text('{"Frames": [[1')


BAD_INPUT = {
    "out of range": (
        lambda p: set_params(p, {"alpha": -1.0}), "sample", "alpha must be float in [0, 10]",
    ),
    "no such robot": (lambda p: set_params(p, {"robot": "comann"}), "robot", "no robot 'comann'"),
    "no such clips": (lambda p: set_params(p, {"clips": "none"}), "clips", "none"),
    "truncated": (cut_short, "clips", "swing_2.txt"),
    "binary": (
        lambda p: handmade.write(p / "data/clips/mine/train/odd.bvh", b"\x00\xff" * 500),
        "clips", "odd.bvh",
    ),
    "misspelt": (lambda p: set_params(p, {"sample": {"rowz": 3}}), "sample", "did you mean rows?"),
}  # fmt: skip


@pytest.fixture
def copy(project, tmp_path):
    """What the first stages read, in a folder of its own, without dvc."""
    for name in ("data/clips", "data/robot"):
        shutil.copytree(project / name, tmp_path / name)
    for name in ("params.yaml", "data/mocap_pairs.parquet"):
        shutil.copy(project / name, tmp_path / name)
    return tmp_path


@pytest.mark.parametrize("kind", BAD_INPUT)
def test_bad_input_stops_a_stage_in_one_clear_line_and_changes_nothing(
    copy, kind, monkeypatch, capfd
):
    break_it, stage, words = BAD_INPUT[kind]
    break_it(copy)
    before = {path: path.read_bytes() for path in copy.rglob("*") if path.is_file()}
    assert words in stopped(stage, copy, monkeypatch, capfd)
    assert before == {path: path.read_bytes() for path in copy.rglob("*") if path.is_file()}


@pytest.mark.parametrize("kind", ["truncated", pytest.param("out of range", marks=WIDE)])
def test_bad_input_ends_dvc_in_one_clear_line_and_the_next_run_completes(here, kind):
    break_it, stage, words = BAD_INPUT[kind]
    break_it(here)
    done = shell(here, "dvc", "repro", stage)
    assert done.returncode != 0
    assert words in done.stdout + done.stderr
    assert "Traceback" not in done.stderr
    assert not list(here.rglob("*.part"))
    good(here, "git", "checkout", "-q", "params.yaml", "data/clips")
    good(here, "dvc", "repro", stage)
    assert not stale(here, stage)


def test_a_table_of_another_robot_stops_the_stage(copy, monkeypatch, capfd):
    set_params(copy, {"robot": "coman_authors"})
    run("robot", copy, monkeypatch)
    line = stopped("index@skeleton_pairs", copy, monkeypatch, capfd)
    assert line.startswith("TableError: data/mocap_pairs.parquet was made for robot 'coman ")
    assert "dvc repro pair" in line


def test_clips_may_lie_anywhere_and_a_change_in_them_is_seen(here, tmp_path):
    swing(tmp_path / "clips" / "train" / "a.txt", 0.0, 9)
    swing(tmp_path / "clips" / "test" / "b.txt", 1.0, 9)
    set_params(here, {"clips": str(tmp_path / "clips")})
    assert {"clips", "skeletons"} <= ran(good(here, "dvc", "repro", "skeletons"))
    assert not stale(here, "skeletons")
    swing(tmp_path / "clips" / "test" / "b.txt", 2.0, 9)
    assert str(tmp_path / "clips") in str(stale(here, "skeletons")["clips"])


# --- the engine under dvc


@WIDE  # a kill of each way of writing is in test_disasters, a dozen of the engine in test_engine
@pytest.mark.parametrize("kills", [1, 8])
def test_killed_at_random_moments_the_next_run_ends_with_the_bytes_of_a_calm_one(here, kills):
    """kill -9 of dvc, of the stage, of a worker; with another number of workers each time."""
    luck, shelf = random.Random(3), here / "data" / "shards"
    set_params(here, {"sample": {"rows": 5_000 * kills}, "shard_rows": 400, "workers": 1})
    good(here, sys.executable, "-m", "pipeline.sample")
    calm = table(here)
    shutil.rmtree(shelf)
    good(here, "dvc", "checkout", "-q", "--force")
    killed = {"dvc": 0, "stage": 0, "worker": 0}
    while sum(killed.values()) < kills:
        set_params(here, {"workers": luck.choice([1, 2, 3])})
        whom = min(killed, key=killed.get)
        top = subprocess.Popen(
            ["sh", "-c", "exec dvc repro -f -s sample > said 2>&1"],
            cwd=here, env=environment(here),
        )  # fmt: skip
        stage = None
        while top.poll() is None and not stage:
            time.sleep(0.05)
            below = family(psutil.Process(top.pid))
            stage = next((p for p, words in below if "pipeline.sample" in words), None)
        if not stage:  # dvc was killed while it wrote a file of its own, which it cannot read now
            mend(here, (here / "said").read_text())
            continue
        time.sleep(luck.uniform(0.2, 3.5))
        victim = {"dvc": psutil.Process(top.pid) if top.poll() is None else None, "stage": stage}
        workers = [p for p, words in family(stage) if "spawn_main" in words]
        victim["worker"] = luck.choice(workers) if workers else stage
        try:
            victim[whom].kill()
            killed[whom] += 1
        except (AttributeError, psutil.NoSuchProcess):
            shutil.rmtree(shelf)  # it was done before; all over again
        top.wait()
    good(here, "git", "checkout", "-q", "dvc.lock")
    after_kills(here, "dvc", "repro", "sample")
    assert table(here) == calm
    assert not list((here / "data").rglob("*.part"))
    assert not stale(here, "sample")


def family(process: psutil.Process) -> list[tuple[psutil.Process, str]]:
    """A process's descendants with their command lines."""
    found = []
    try:
        for child in process.children(recursive=True):
            found.append((child, " ".join(child.cmdline())))
    except psutil.Error:
        pass  # one of them ended meanwhile
    return found


def test_a_stage_stops_when_its_dvc_is_gone(here):
    set_params(here, {"sample": {"rows": 400_000}, "shard_rows": 400})
    top = subprocess.Popen(
        ["dvc", "repro", "sample"], cwd=here, env=environment(here),
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    shelf = here / "data" / "shards"
    before = set(shelf.rglob("*.parquet"))
    while not set(shelf.rglob("*.parquet")) - before:
        time.sleep(0.1)
        assert top.poll() is None
    below = [process for process, _ in family(psutil.Process(top.pid))]
    top.kill()
    top.wait()
    _, alive = psutil.wait_procs(below, timeout=15)
    assert not alive


@WIDE  # where the shards lie is known to test_engine
def test_a_temporary_experiment_keeps_its_shards_in_the_project(here):
    before = set((here / "data" / "shards").iterdir())
    good(here, "dvc", "exp", "run", "--temp", "-S", "alpha=0.7", "sample")
    new = set((here / "data" / "shards").iterdir()) - before
    assert [path.name.split("-")[0] for path in new] == ["kinematic_pairs"]
    assert '"alpha": 0.7' in (new.pop() / "about.json").read_text()


@WIDE  # the same by the stages' own functions: test_onboard_sold, test_front_door
def test_another_robot_goes_from_its_urdf_to_certified_motion(here):
    home = Path(pytest.importorskip("jvrc_description").__file__).parent
    s3le = (sys.executable, "-m", "s3le.cli")
    good(here, *s3le, "robot", "new", str(home / "urdf" / "jvrc1.urdf"), "--name", "jvrc")
    try:
        output = good(here, "dvc", "exp", "run", "-S", "robot=jvrc", "export", "evaluate@s3le")
        assert {"robot", "pair", "sample", "truth", "export", "evaluate@s3le"} <= ran(output)
        assert "clips" not in ran(output) and "skeletons" not in ran(output)
        figures = json.loads((here / "data/counts/evaluate-s3le.json").read_text())
        for part in figures.values():
            assert part["all"]["collision_rate"] == part["all"]["limit_rate"] == 0.0
        swing(here / "wave.txt", 0.3, 12)
        good(here, *s3le, "retarget", "wave.txt", "--out", "motions",
             "--model", "data/retargeter")  # fmt: skip
        assert "CERTIFIED" in good(here, *s3le, "audit", "motions/wave.parquet")
    finally:
        shutil.rmtree(here / "motions", ignore_errors=True)
        for left in [here / "wave.txt", *(here / "data/robots").rglob("jvrc*")]:
            left.unlink(missing_ok=True)
