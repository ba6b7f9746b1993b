"""The benchmark of the field as it runs: processes that fail, environments, whole small runs."""

import json
import sys

import numpy as np
import pytest
from rivalled import SHARED, opened, task_of
from streaming import motion, retargeter

rooms = pytest.fixture(scope="module")(opened)

WORKERS = {
    "dies": "raise SystemExit('the third went wrong')",
    "stalls": "time.sleep(60)",
}


@pytest.mark.parametrize("how", ["dies", "stalls"])
def test_a_motion_that_is_too_much_is_lost_and_the_others_are_made(
    rooms, monkeypatch, tmp_path, how
):
    one = rooms.entrants.by_key("mink")[0]
    (tmp_path / "worker.py").write_text(
        "import json, sys, time, pathlib\n"
        "for task, out in json.loads(pathlib.Path(sys.argv[1]).read_text())['motions']:\n"
        "    if 'made_2' in out:\n"
        f"        {WORKERS[how]}\n"
        "    pathlib.Path(out).write_text('made')\n"
    )
    monkeypatch.setattr(rooms.run, "HERE", tmp_path)
    monkeypatch.setattr(rooms.run.install, "python", lambda name: sys.executable)
    task = task_of(rooms, motion(2))
    todo = [
        rooms.run.Job(one, {}, "coman", task, 1, 0, tmp_path / f"made_{i}.npz") for i in range(5)
    ]
    files = {task.digest: tmp_path / "task.npz"}
    told = rooms.run.perform(todo, "coman", tmp_path, files, None, None, patience=3.0)
    assert [job.out.is_file() for job in todo] == [True, True, False, True, True]
    assert ("went wrong" if how == "dies" else "no motion within 3 s") in told


def test_an_entrant_that_does_not_begin_is_not_tried_again(rooms, monkeypatch, tmp_path):
    one = rooms.entrants.by_key("mink")[0]
    (tmp_path / "worker.py").write_text(
        f"open({str(tmp_path / 'calls')!r}, 'a').write('x'); raise ImportError('no mink here')"
    )
    monkeypatch.setattr(rooms.run, "HERE", tmp_path)
    monkeypatch.setattr(rooms.run.install, "python", lambda name: sys.executable)
    task = task_of(rooms, motion(2))
    todo = [rooms.run.Job(one, {}, "coman", task, 1, 0, tmp_path / f"m{i}.npz") for i in range(3)]
    files = {task.digest: tmp_path / "task.npz"}
    assert "no mink here" in rooms.run.perform(todo, "coman", tmp_path, files, None, None)
    assert (tmp_path / "calls").read_text() == "x"


@pytest.mark.wide
def test_an_environment_that_fails_leaves_the_others(rooms, monkeypatch, tmp_path):
    lock = tmp_path / "a.lock"
    lock.write_text("[bad]\nno-such-package-of-anybody==0.0.1\n[good]\n# nothing\n")
    monkeypatch.setattr(rooms.install, "LOCK", lock)
    monkeypatch.setattr(rooms.install, "FOLDER", tmp_path / "envs")
    monkeypatch.setenv("PIP_ARGS", "--no-index")
    with pytest.raises(SystemExit, match="not set up: envs/bad"):
        rooms.install.main()
    assert rooms.install.python("good").exists() and not rooms.install.python("bad").exists()
    made = (tmp_path / "envs/good/made-of.txt").stat().st_mtime_ns
    with pytest.raises(SystemExit, match="not set up: envs/bad"):
        rooms.install.main()
    assert (tmp_path / "envs/good/made-of.txt").stat().st_mtime_ns == made


def test_a_data_set_is_made_of_mirrored_clips_at_other_speeds(rooms):
    punch = SHARED / "other/deepmimic/humanoid3d_punch.txt"
    if not punch.is_file():
        pytest.skip("no motions beside the checkout")
    its = retargeter()
    every = rooms.throughput.variants(its, [punch], 4)
    assert len({one.digest for one in every}) == 4
    whole = rooms.tasks.clips(its, [punch], "made", 0, 1)[0]
    for i, one in enumerate(every):
        bones = one.x.reshape(-1, 7, 3)
        np.testing.assert_allclose(np.linalg.norm(bones, axis=2), 1.0)
        first = rooms.streams.mirrored(whole.x[:1]) if i % 2 else whole.x[:1]
        np.testing.assert_allclose(one.x[:1], first, atol=1e-9)
        assert len(whole.x) / 1.4 - 2 <= len(one.x) <= len(whole.x) / 0.7 + 2
    again = rooms.throughput.variants(its, [punch], 4)
    assert [one.digest for one in again] == [one.digest for one in every]


@pytest.mark.wide
def test_a_data_set_is_timed_after_the_first_motion(rooms, tmp_path):
    if not SHARED.is_dir():
        pytest.skip("no motions beside the checkout")
    found = rooms.throughput.table(
        rooms.entrants.by_key("file,stream"), "coman", tmp_path, SHARED / "other/deepmimic",
        tmp_path, 1, count=3, sample=2,
    )  # fmt: skip
    file, stream = found["rows"]
    assert (file["clips"], stream["clips"], file["lost"], stream["lost"]) == (3, 2, 0, 0)
    assert file["frames"] > 0 and file["rate"] == pytest.approx(file["frames"] / file["seconds"])
    assert file["days"] == pytest.approx(1e9 / file["rate"] / 86400.0)
    assert file["cost"] == pytest.approx(file["days"] * 24.0 * found["price"])


@pytest.mark.wide
@pytest.mark.parametrize("rival", ["stream", "mink"])
def test_quick_with_two_entrants(rooms, rival, tmp_path):
    if not SHARED.is_dir():
        pytest.skip("no motions beside the checkout")
    if rival == "mink" and not rooms.install.python("field").is_file():
        pytest.skip("the rivals' environment is not set up: make rivals")
    given = dict(
        quick=True, only=f"file,{rival}", frames=20, cmu=SHARED / "cmu",
        demo=SHARED / "other/deepmimic", work=tmp_path / "work", reports=tmp_path, workers=1,
        everything=False, robots="coman", protocols="", lafan=None, clones=None,
        data_set=False, clip=None,
    )  # fmt: skip
    rooms.run.main(**given)
    record = json.loads((tmp_path / "rivals.json").read_text())
    by = {(row["key"], row["adversarial"]): row for row in record["rows"]}
    assert set(by) == {(key, hard) for key in ("file", rival) for hard in (False, True)}
    for (key, _), row in by.items():
        assert row["motions"] == row["clips"] and row["frames"] > 0 and row["size_mb"] > 1.0
        assert row["first_s"] > 0.0
        if key != "mink":
            assert row["poses_broken"]["value"] == row["paths_broken"]["value"] == 0.0
            assert row["paths_unproven"]["value"] == 0.0 and row["repair_left"] == 0
    assert by["file", False]["same"] is True and by[rival, False]["same"] is True
    assert (tmp_path / "rivals.html").stat().st_size > 20_000
    files = {path: path.stat().st_mtime_ns for path in (tmp_path / "work").rglob("*.npz")}
    first = (tmp_path / "rivals.csv").read_bytes()
    rooms.run.main(**given)  # all is kept
    assert files == {p: p.stat().st_mtime_ns for p in (tmp_path / "work").rglob("*.npz")}
    assert (tmp_path / "rivals.csv").read_bytes() == first
