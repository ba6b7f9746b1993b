"""The mutation run: each mutant is one change, a sample grows, and verdicts are kept."""

import ast
import json
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SCRIPT = ROOT / "benchmarks" / "mutation.py"
SOURCE = '''
"""A room."""

LIMIT = 0.5


def over(values, most=3):
    """Those over the limit."""
    found = []
    for value in values:
        if value >= LIMIT and not value == most:
            found.append(max(value, -value))
    total = len(found) + 1
    return total if total > 2 else 0
'''


@pytest.fixture(scope="module")
def asked():
    """What a run of the script's own functions prints, in a process of its own as JSON."""

    def ask(code, *words):
        # It sets what numba is at import, which would hold for all tests of this process.
        head = (
            "import importlib.util, json, sys\n"
            f"spec = importlib.util.spec_from_file_location('mutation', {str(SCRIPT)!r})\n"
            "mutation = importlib.util.module_from_spec(spec); spec.loader.exec_module(mutation)\n"
        )
        done = subprocess.run(
            [sys.executable, "-c", head + code, *words], capture_output=True, text=True,
            check=False, cwd=ROOT,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr[-2000:]
        return json.loads(done.stdout)

    return ask


def test_every_mutant_is_one_other_program_and_all_kinds_occur(asked):
    code = "print(json.dumps([list(one) for one in mutation.mutants(sys.argv[1])]))"
    found = asked(code, SOURCE)
    whole = ast.unparse(ast.parse(SOURCE))
    texts = [text for _, _, text in found]
    assert len(texts) > 25 and whole not in texts
    for text in texts:
        compile(text, "mutant", "exec")
        changed = [pair for pair in zip(whole.splitlines(), text.splitlines(), strict=False)
                   if pair[0] != pair[1]]  # fmt: skip
        assert len(changed) == 1  # one line, the docstrings as they were
    told = " ; ".join(what for _, what, _ in found)
    for kind in (
        "value >= LIMIT -> Gt ", "value == most -> NotEq", "without part 1", "0.5 -> 1.0",
        "3 -> 4", "-> min", "total > 2 -> False", "without: return", "-> its operand",
        "without: found.append", "len(found) + 1",
    ):  # fmt: skip
        assert kind.strip() in told, kind


def test_a_larger_sample_holds_the_smaller_one_and_a_seed_is_a_sample(asked):
    code = """
keys = {n: [key for key, _ in mutation.sample('a.py', sys.argv[1], n, seed)]
        for n, seed in ((4, 1), (9, 1), (0, 1))}
keys['other'] = [key for key, _ in mutation.sample('a.py', sys.argv[1], 4, 2)]
print(json.dumps(keys))
"""
    keys = asked(code, SOURCE)
    assert set(keys["4"]) < set(keys["9"]) < set(keys["0"]) and len(keys["9"]) == 9
    assert keys["other"] != keys["4"] and set(keys["other"]) < set(keys["0"])


def test_every_room_names_files_and_tests_that_are_there(asked):
    rooms = asked("print(json.dumps(mutation.ROOMS))")
    assert {"proof", "guard", "certificate", "audit", "projection"} <= set(rooms)
    for files, tests, _ in rooms.values():
        for name in (*files, *tests):
            assert (ROOT / name).is_file(), name


@pytest.mark.wide
def test_a_mutant_that_a_test_sees_is_killed_and_one_that_none_sees_survives(asked, tmp_path):
    folder = tmp_path / "project"
    (folder / "s3le").mkdir(parents=True)
    (folder / "s3le" / "__init__.py").touch()
    (folder / "tests").mkdir()
    test = "from s3le.a import over\n\ndef test_a():\n    assert over([1, 2, 0.1]) == 3\n"
    (folder / "tests" / "test_a.py").write_text(test)
    code = """
from pathlib import Path
place = object.__new__(mutation.Copy)
place.folder = Path(sys.argv[1])
room = mutation.Room((), ("tests/test_a.py",))
out = {}
for name, old, new in (("as it is", "x", "x"), ("seen", "+ 1", "+ 2"), ("unseen", "0.5", "0.4"),
                       ("slow", "found = []", "import time; time.sleep(60); found = []")):
    (place.folder / "s3le" / "a.py").write_text(sys.argv[2].replace(old, new))
    out[name] = place.tests(room, 2.0 if name == "slow" else 120.0)
print(json.dumps(out))
"""
    found = asked(code, str(folder), SOURCE)
    assert found == {"as it is": "survived", "seen": "killed by tests/test_a.py::test_a",
                     "unseen": "survived", "slow": "slow"}  # fmt: skip
