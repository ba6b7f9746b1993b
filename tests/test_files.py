import os
import subprocess

import pytest

from s3le.store.atomic import replace


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_a_file_appears_whole_and_alone(tmp_path):
    replace(tmp_path / "new" / "a.txt", lambda part: part.write_text("one"))
    replace(tmp_path / "new" / "a.txt", lambda part: part.write_text("two"))
    assert names(tmp_path / "new") == ["a.txt"]
    assert (tmp_path / "new" / "a.txt").read_text() == "two"


def test_a_failed_write_leaves_the_old_file_and_no_scrap(tmp_path):
    (tmp_path / "a.txt").write_text("old")

    def half(part):
        part.write_text("ha")
        raise OSError("disk full")

    with pytest.raises(OSError, match="disk full"):
        replace(tmp_path / "a.txt", half)
    assert names(tmp_path) == ["a.txt"] and (tmp_path / "a.txt").read_text() == "old"


def test_what_a_killed_process_left_is_cleared_away_and_nothing_else(tmp_path):
    ended = subprocess.Popen(["true"])
    ended.wait()
    alive, gone = os.getppid(), ended.pid
    others = [f".a.txt.{alive}.part", ".a.txt.old.part", "a.part", f"a.{gone}.part"]
    for name in [f".a.txt.{gone}.part", f".b.txt.{gone}.part", *others]:
        (tmp_path / name).write_text("scrap")
    replace(tmp_path / "a.txt", lambda part: part.write_text("new"))
    assert names(tmp_path) == sorted(["a.txt", *others])
