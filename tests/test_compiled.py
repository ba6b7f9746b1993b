"""Kernels are compiled once a machine: where they are kept, and what would compile them anew."""

import fcntl
import threading

import numpy as np
from fresh import python
from worlds import coman

from s3le.kernels import batch, compiled
from s3le.safety import segment
from s3le.safety.paths import certify


def test_kernels_are_kept_where_it_can_be_written(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    monkeypatch.setattr(compiled, "_HERE", tmp_path / "package")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(compiled.config, "CACHE_DIR", str(tmp_path / "chosen"))
    assert compiled.place() == tmp_path / "chosen"
    monkeypatch.setattr(compiled.config, "CACHE_DIR", "")
    assert compiled.place() == tmp_path / "cache" / "s3le"
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    assert compiled.place() == tmp_path / "package" / "__pycache__"
    monkeypatch.setattr(compiled, "_HERE", tmp_path / "file")
    assert compiled.place() is None


def test_kernels_that_cannot_be_kept_are_compiled_all_the_same():
    code = ("from s3le.kernels import compiled\n"
            "assert not compiled.kept() and not compiled.stored('pursue.pursue')\n"
            "print(compiled.compiled(lambda x: 2 * x)(21))")  # fmt: skip
    said = python(code, NUMBA_CACHE_DIR="/dev/null/none", XDG_CACHE_HOME="/dev/null/none")
    assert said.returncode == 0 and said.stdout == "42\n", said.stderr


def test_processes_that_compile_take_turns_in_writing(tmp_path, monkeypatch):
    """numba numbers the files of a function: two writers at once could mix two signatures."""
    monkeypatch.setattr(compiled, "_STORE", tmp_path)
    done = []
    save = compiled._in_turn(lambda *words: done.append(words))
    with (tmp_path / ".lock").open("a") as other:
        fcntl.flock(other, fcntl.LOCK_EX)
        waiting = threading.Thread(target=save, args=("key", "data"))
        waiting.start()
        waiting.join(0.3)
        assert waiting.is_alive() and not done
    waiting.join(10)
    assert done == [("key", "data")]
    assert batch._project._cache._cache_file.save.__qualname__.startswith("_in_turn")


def test_poses_of_a_file_are_no_reason_to_compile_anew():
    """Arrays that a file gives are read-only, which is another type to numba: 15 seconds."""
    doors = (batch._skeletons, batch._clearances, segment.prove_rows)
    q = np.stack([coman().anchor, coman().anchor])

    def through():
        batch.skeletons(coman().chain, q)
        batch.clearances(coman().chain, q)
        certify(coman(), q, 0.0005)

    through()
    before = [len(door.signatures) for door in doors]
    q.setflags(write=False)
    through()
    assert [len(door.signatures) for door in doors] == before


def test_no_frame_of_a_warm_retargeter_waits_for_a_kernel():
    """In a process of its own: what other tests have loaded would hide what is missing."""
    code = """
import sys
sys.path.insert(0, "tests")
from streaming import motion, retargeter
from s3le.plan import causal, pursue
from s3le.retarget import refine
doors = (pursue.pursue, refine.refine, causal.safe, causal.brake)
def known():
    return [len(door.signatures) for door in doors]
it = retargeter()
it.warm_up()
warm = known()
stream = it.start()
modes = {str(stream.step(x, 1 / 30).mode) for x in motion(40)[::4]}
assert "limited" in modes and all(warm) and known() == warm, (warm, known(), modes)
"""
    said = python(code)
    assert said.returncode == 0, said.stderr
