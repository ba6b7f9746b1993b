"""Broken files through every reader: refused in one line that names the file, or read as they are.

Each reader runs in a process of its own with bounded memory and time (see doors), so a crash is
a failed test and not the end of the tests. `pytest -s --mutants=10000 tests/test_mutants.py` sends
that many through each; a failure names the number of the mutant, which is always the same one.

What is counted as what:

- "refused": one of our own errors, one printable line of bounded length that names the file.
- "read": a result by every law of the format: what the reader gave is what the bytes say when the
  grammar is applied to them again by other means (doors), all of it, in range. A mutant whose
  bytes are another valid file counts here: nobody can tell 12.53 from 13.53.
- "accepted", a silent acceptance, fails: a result although a law is broken, or another result
  than the law gives. Where files carry checksums, any result but the good file's is one.
- "crash" (any other exception, a signal), "slow" (more than 2 s of processor time, twice), more
  memory than 512 MiB beyond the good file's, "words" (a refusal of several lines, without the
  file, endless, or anything printed) and "written" (files changed) fail too.
"""

import json
import os
import struct
import subprocess
import sys
import time
from pathlib import Path

import pytest
from doors import DOORS, REAL
from handmade import SHARED, asf
from mutants import KINDS, mutant

HERE = Path(__file__).parent
ONE_THREAD = {f"{name}_NUM_THREADS": "1" for name in ("OMP", "MKL", "OPENBLAS", "NUMBA")}
SHOWN = 12  # failures of a reader that are printed


@pytest.fixture(scope="module")
def doors():
    """Failures and counts of a reader's mutants, and the most memory it had [bytes], by name."""
    paths = os.pathsep.join([str(HERE.parent), str(HERE)])
    own = {"PYTHONPATH": paths, "POLARS_MAX_THREADS": "1", "MALLOC_ARENA_MAX": "1", **ONE_THREAD}
    with subprocess.Popen(
        [sys.executable, str(HERE / "doors.py")], env=os.environ | own, text=True,
        stdin=subprocess.PIPE, stdout=subprocess.PIPE,
    ) as served:  # fmt: skip

        def sent(name, first, count, folder):
            print(json.dumps([name, first, count, str(folder)]), file=served.stdin, flush=True)
            status = int(served.stdout.readline())
            said = (folder / "err").read_text()
            mark = folder / "number"
            number = struct.unpack("<q", mark.read_bytes())[0] if mark.is_file() else "none"
            assert status == 0, f"{name}: mutant {number} ended its reader: {said[-2000:]}"
            assert said == "", f"{name}: something was printed: {said[-2000:]}"
            lines = [json.loads(line) for line in (folder / "out").read_text().splitlines()]
            return lines[:-1], lines[-1]["counts"], lines[-1]["most"]

        yield sent


def hold(doors, name, count, folder):
    begin = time.monotonic()
    wrong, counts, most = doors(name, 0, count, folder)
    took = f"{time.monotonic() - begin:.1f} s, at most {most / 2**20:.0f} MiB"
    print(f"{name}: {counts}, {took}")
    told = "\n".join(json.dumps(one) for one in wrong[:SHOWN])
    assert not wrong, f"{name}: {counts}\n{told}"
    assert counts["refused"] > 0.3 * count  # or the mutants are not what they say


@pytest.mark.parametrize("name", DOORS)
def test_a_broken_file_is_refused_in_one_line_or_read_as_it_stands(tmp_path, name, request, doors):
    hold(doors, name, request.config.getoption("--mutants"), tmp_path)


@pytest.mark.skipif(not SHARED.is_dir(), reason="needs the real clips beside the project")
@pytest.mark.parametrize("name", REAL)
def test_a_broken_copy_of_a_real_clip_is_refused_in_one_line_or_read_as_it_stands(
    tmp_path, name, request, doors
):
    hold(doors, name, request.config.getoption("--mutants") // 3, tmp_path)


# --- the mutants themselves


def test_a_mutant_is_the_same_one_whenever_it_is_made():
    good = [asf().encode()]
    assert all(mutant(good[0], good, f"{n}") == mutant(good[0], good, f"{n}") for n in range(40))


def test_every_way_to_break_a_file_comes_up_and_breaks_it():
    good = asf().encode()
    done = [mutant(good, [b"other\n" * 9], f"{n}") for n in range(1500)]
    assert {kind.__name__ for kind in KINDS} <= {how for _, how in done}
    assert sum(copy != good for copy, _ in done) > 0.95 * len(done)
    assert max(len(copy) for copy, _ in done) < 2**24  # [bytes]
