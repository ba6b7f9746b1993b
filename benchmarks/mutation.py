"""Do the tests see it? One small change after another in a file, and the tests that should fail.

    python benchmarks/mutation.py                      a sample of every file of the table below
    python benchmarks/mutation.py proof audit -n 100   other rooms or files, other numbers; 0: all
    python benchmarks/mutation.py --again              what survived, once more, against new tests
    python benchmarks/mutation.py --score              only what is known so far

A mutant is one operator, comparison, constant, condition or returned value that is another, or one
statement that is gone. It is written into a copy of the project in a temporary folder, and the
tests of its room run there until one fails. That is the verdict: killed, survived, or too slow,
which counts as killed. Each verdict is a line of data/mutation.jsonl, keyed by the file's text
and the mutant, so that a run that was stopped goes on and a changed file begins anew.

Kernels run uncompiled, so that nothing has to be compiled for a mutant; tests of a room are those
that are quick enough for that. What survives them and is no matter is said in docs/mutation.md.
"""

import argparse
import ast
import copy
import hashlib
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

os.environ |= {
    "OMP_NUM_THREADS": "1", "NUMBA_DISABLE_JIT": "1", "PYTHONDONTWRITEBYTECODE": "1",
}  # fmt: skip
sys.dont_write_bytecode = True
# A script's own folder comes first, where other benchmarks have the names of packages.
sys.path[:] = [path for path in sys.path if Path(path).resolve() != Path(__file__).parent.resolve()]

import coal  # noqa: E402, F401  (these are what every test loads)
import numba  # noqa: E402, F401
import numpy as np  # noqa: E402
import pinocchio  # noqa: E402, F401
import pytest  # noqa: E402
import scipy.optimize  # noqa: E402, F401

ROOT = Path(__file__).resolve().parents[1]
RECORD = ROOT / "data" / "mutation.jsonl"
SLOWEST = 4.0  # times as long as without a mutant that tests may take, and
PATIENCE = 60.0  # [s], this much more


class Room(NamedTuple):
    """Files and the tests that watch over them."""

    files: tuple[str, ...]
    tests: tuple[str, ...]  # as pytest takes them
    only: str = ""  # expression for pytest -k


ROOMS = {
    "proof": Room(
        ("s3le/safety/segment.py", "s3le/safety/swept.py", "s3le/safety/paths.py"),
        ("tests/test_proof.py",),
    ),
    "guard": Room(
        ("s3le/plan/causal.py", "s3le/plan/around.py", "s3le/plan/limits.py"),
        ("tests/test_plan.py", "tests/test_around.py"),
    ),
    "certificate": Room(("s3le/robot/certificate.py",), ("tests/test_certificate.py",)),
    "audit": Room(
        ("s3le/safety/audit.py",), ("tests/test_audit.py",), "not deep_poses and not decided_is_not"
    ),
    "projection": Room(
        ("s3le/kernels/qp.py", "s3le/kernels/solver.py"),
        ("tests/test_qp.py", "tests/test_solver.py"),
    ),
    "training": Room(
        ("s3le/learn/losses.py", "s3le/learn/batches.py", "s3le/learn/training.py"),
        ("tests/test_terms.py", "tests/test_losses.py", "tests/test_training.py"),
    ),
    "comparison": Room(
        ("s3le/study/comparison.py", "s3le/study/evaluation.py", "s3le/study/metrics.py"),
        ("tests/test_comparison.py", "tests/test_evaluation.py", "tests/test_metrics.py"),
    ),
    "pairs": Room(
        (
            "s3le/human/splits.py",
            "s3le/tuples/pairing.py",
            "s3le/study/truth.py",
            "s3le/tuples/ik.py",
        ),  # fmt: skip
        ("tests/test_splits.py",),
    ),
}
USUAL = ("proof", "guard", "certificate", "audit", "projection")
ARITHMETIC = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.Pow: ast.Mult,
    ast.FloorDiv: ast.Mult, ast.Mod: ast.Mult, ast.BitAnd: ast.BitOr, ast.BitOr: ast.BitAnd,
}  # fmt: skip
COMPARED = {
    ast.Lt: (ast.LtE, ast.Gt), ast.LtE: (ast.Lt, ast.Gt), ast.Gt: (ast.GtE, ast.Lt),
    ast.GtE: (ast.Gt, ast.Lt), ast.Eq: (ast.NotEq,), ast.NotEq: (ast.Eq,), ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,), ast.In: (ast.NotIn,), ast.NotIn: (ast.In,),
}  # fmt: skip


class Mutant(NamedTuple):
    """One change of a file."""

    line: int
    what: str  # as a person reads it
    text: str  # the whole file


def mutants(source: str) -> list[Mutant]:
    """All that can be changed in a file, in the order of its lines; docstrings stay."""
    tree = ast.parse(source)
    found = []
    for node, change, what in _changes(tree):
        undo = change()
        text = ast.unparse(tree)
        undo()
        found.append(Mutant(node.lineno, what, text))
    same = ast.unparse(tree)
    return [one for one in found if one.text != same]


def _changes(tree: ast.Module) -> Iterator[tuple[ast.AST, Any, str]]:
    """Triples (node, what makes the change and returns what takes it back, in words)."""
    told = set()  # what is only said of types
    for node in ast.walk(tree):
        for name in ("annotation", "returns"):
            if (hint := getattr(node, name, None)) is not None:
                told.update(map(id, ast.walk(hint)))
    for node in ast.walk(tree):
        if id(node) in told:
            continue
        if isinstance(node, (ast.BinOp, ast.AugAssign)) and type(node.op) in ARITHMETIC:
            yield node, _put(node, "op", ARITHMETIC[type(node.op)]()), _said(node)
        elif isinstance(node, ast.BoolOp):
            other = ast.Or() if isinstance(node.op, ast.And) else ast.And()
            yield node, _put(node, "op", other), _said(node)
            for k in range(len(node.values)):
                left = [one for i, one in enumerate(node.values) if i != k]
                yield node, _put(node, "values", left), f"{_said(node)} without part {k + 1}"
        elif isinstance(node, ast.Compare):
            for k, op in enumerate(node.ops):
                for other in COMPARED[type(op)]:
                    ops = [*node.ops[:k], other(), *node.ops[k + 1 :]]
                    yield node, _put(node, "ops", ops), f"{_said(node)} -> {other.__name__}"
        elif isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.Not, ast.USub, ast.Invert)):
            if isinstance(node.op, ast.USub) and isinstance(node.operand, ast.Constant):
                continue  # a negative number is a constant
            yield node, _become(node, node.operand), f"{_said(node)} -> its operand"
        elif isinstance(node, ast.Constant) and type(node.value) in (int, float, bool):
            for other in _other_constants(node.value):
                yield node, _put(node, "value", other), f"{node.value!r} -> {other!r}"
        elif isinstance(node, (ast.If, ast.While, ast.IfExp)):
            for truth in (True, False):
                if not (truth and isinstance(node, ast.While)):
                    test = ast.copy_location(ast.Constant(truth), node.test)
                    yield node, _put(node, "test", test), f"if {_said(node.test)} -> {truth}"
        elif isinstance(node, ast.Call) and getattr(node.func, "id", "") in ("min", "max"):
            other = "max" if node.func.id == "min" else "min"
            yield node, _put(node.func, "id", other), f"{_said(node)} -> {other}"
        for name in ("body", "orelse"):
            block = getattr(node, name, None)
            if isinstance(block, list):
                yield from _without_statements(node, name, block)


def _without_statements(node: ast.AST, name: str, block: list) -> Iterator:
    for k, one in enumerate(block):
        simple = (ast.Assign, ast.AugAssign, ast.Return, ast.Raise, ast.Continue, ast.Break)
        call = isinstance(one, ast.Expr) and isinstance(one.value, ast.Call)
        if not isinstance(node, (ast.Module, ast.ClassDef)) and (isinstance(one, simple) or call):
            gone = [*block[:k], ast.copy_location(ast.Pass(), one), *block[k + 1 :]]
            yield one, _put(node, name, gone), f"without: {_said(one)}"


def _other_constants(value: float | bool) -> tuple:
    if isinstance(value, bool):
        return (not value,)
    if isinstance(value, int):
        return (value + 1, value - 1) if value else (1,)
    return (2.0 * value, 0.5 * value) if value else (1.0,)


def _put(node: ast.AST, name: str, other: Any) -> Any:
    def change():
        old = getattr(node, name)
        setattr(node, name, other)
        return lambda: setattr(node, name, old)

    return change


def _become(node: ast.AST, other: ast.AST) -> Any:
    """Let a node be another one, in whatever field of whatever parent it is."""

    def change():
        kind, fields = node.__class__, dict(node.__dict__)
        twin = copy.copy(other)
        node.__class__ = twin.__class__
        node.__dict__.clear()
        node.__dict__.update(twin.__dict__)

        def undo():
            node.__class__ = kind
            node.__dict__.clear()
            node.__dict__.update(fields)

        return undo

    return change


def _said(node: ast.AST) -> str:
    return " ".join(ast.unparse(node).split())[:80]


class Copy:
    """A copy of the project in which one file at a time is another."""

    def __init__(self, folder: Path) -> None:
        """Copy what git knows of, and what is new."""
        self.folder = folder
        listed = subprocess.run(
            ["git", "ls-files", "-co", "--exclude-standard", "s3le", "pipeline", "tests",
             "benchmarks", "data/robots", "*.toml", "*.yaml"],
            cwd=ROOT, capture_output=True, text=True, check=True,
        ).stdout.splitlines()  # fmt: skip
        for name in listed:
            if (ROOT / name).is_file():
                (folder / name).parent.mkdir(parents=True, exist_ok=True)
                (folder / name).write_bytes((ROOT / name).read_bytes())
        shared = ROOT.parent / "shared"
        if shared.exists():
            (folder.parent / "shared").symlink_to(shared.resolve())

    def tests(self, room: Room, limit: float) -> str:
        """Run a room's tests: "survived", "slow", or "killed by" the first that fails."""
        some = [name for name in room.tests if (self.folder / name).is_file()]
        if not some:
            raise SystemExit(f"mutation: none of {', '.join(room.tests)} is here")
        words = ["-q", "-x", "-p", "no:cacheprovider", *some]
        words += ["-k", room.only] if room.only else []
        said = self.folder.parent / "said"
        # A child of this process has the libraries that it has loaded, which else take longer
        # than the tests; of the project this process has loaded nothing.
        assert not any(name.split(".")[0] == "s3le" for name in sys.modules)
        child = os.fork()
        if child == 0:
            try:
                os.setsid()
                out = os.open(said, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
                os.dup2(out, 1)
                os.dup2(out, 2)
                os.chdir(self.folder)
                sys.path.insert(0, str(self.folder))
                status = int(pytest.main(words))
            except BaseException:
                traceback.print_exc()
                status = 1
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(status)
        began = time.monotonic()
        while (ended := os.waitpid(child, os.WNOHANG))[0] == 0:
            if time.monotonic() - began > limit:
                os.killpg(child, signal.SIGKILL)
                os.waitpid(child, 0)
                return "slow"
            time.sleep(0.02)
        code = os.waitstatus_to_exitcode(ended[1])
        if code == pytest.ExitCode.OK:
            return "survived"
        if code in (pytest.ExitCode.USAGE_ERROR, pytest.ExitCode.NO_TESTS_COLLECTED):
            raise SystemExit(f"mutation: pytest found no tests: {' '.join(words)}")
        lines = said.read_text(encoding="utf-8", errors="replace").splitlines()
        failed = [line for line in lines if line.startswith(("FAILED", "ERROR"))]
        return f"killed by {failed[0].split(' ')[1]}" if failed else "killed"


def judge(rooms: dict[str, Room], number: int, seed: int, again: bool) -> None:
    """Run what is not known yet."""
    known = {one["key"]: one for one in read()}
    with tempfile.TemporaryDirectory(prefix="mutation-") as top:
        place = Copy(Path(top) / "project")
        for name, room in rooms.items():
            began = time.monotonic()
            if place.tests(room, np.inf) != "survived":
                raise SystemExit(f"mutation: the tests of {name} fail without a mutant")
            limit = SLOWEST * (time.monotonic() - began) + PATIENCE
            for file in room.files:
                whole = (ROOT / file).read_text(encoding="utf-8")
                for key, mutant in sample(file, whole, number, seed):
                    before = known.get(key, {}).get("verdict", "")
                    if before and not (again and before == "survived"):
                        continue
                    (place.folder / file).write_text(mutant.text, encoding="utf-8")
                    verdict = place.tests(room, limit)
                    (place.folder / file).write_text(whole, encoding="utf-8")
                    add({"key": key, "file": file, "line": mutant.line, "what": mutant.what,
                         "verdict": verdict})  # fmt: skip
                    print(f"{file}:{mutant.line}: {mutant.what}: {verdict}", flush=True)


def sample(file: str, whole: str, number: int, seed: int) -> list[tuple[str, Mutant]]:
    """The mutants of a file to try, with their keys; always the same ones for a seed."""
    every = mutants(whole)
    if number:  # the first of one order, so that a larger sample holds a smaller one
        random.Random(f"{seed} {file}").shuffle(every)
        every = sorted(every[:number])
    version = hashlib.sha256(whole.encode()).hexdigest()[:12]
    return [(f"{file} {version} {hashlib.sha256(one.text.encode()).hexdigest()[:16]}", one)
            for one in every]  # fmt: skip


def read() -> list[dict[str, Any]]:
    """What is known; a line that was cut short is none."""
    if not RECORD.is_file():
        return []
    lines = []
    for line in RECORD.read_text(encoding="utf-8").splitlines():
        try:
            lines.append(json.loads(line))
        except ValueError:
            continue
    return lines


def add(one: dict[str, Any]) -> None:
    """Append a verdict."""
    RECORD.parent.mkdir(parents=True, exist_ok=True)
    with RECORD.open("a", encoding="utf-8") as out:
        out.write(json.dumps(one) + "\n")


def score(rooms: dict[str, Room]) -> None:
    """Print a row a file of what is known of its present text, and what survived."""
    last = {one["key"]: one for one in read()}
    alive = []
    print(f"{'file':32s} {'mutants':>8s} {'tried':>6s} {'killed':>7s} {'share':>6s}")
    for room in rooms.values():
        for file in room.files:
            whole = (ROOT / file).read_text(encoding="utf-8")
            version = hashlib.sha256(whole.encode()).hexdigest()[:12]
            mine = [one for key, one in last.items() if key.startswith(f"{file} {version} ")]
            counts = Counter(one["verdict"].split(" ")[0] for one in mine)
            killed = counts["killed"] + counts["slow"]
            share = f"{killed / len(mine):6.0%}" if mine else "     -"
            print(f"{file:32s} {len(mutants(whole)):8d} {len(mine):6d} {killed:7d} {share}")
            alive += [one for one in mine if one["verdict"] == "survived"]
    for one in sorted(alive, key=lambda one: (one["file"], one["line"])):
        print(f"survived: {one['file']}:{one['line']}: {one['what']}")


def chosen(words: list[str]) -> dict[str, Room]:
    """Rooms by name, or a room's file by its path."""
    out = {}
    for word in words or USUAL:
        if word in ROOMS:
            out[word] = ROOMS[word]
            continue
        owner = [name for name, room in ROOMS.items() if word in room.files]
        if not owner:
            raise SystemExit(f"mutation: no room or file '{word}'; rooms: {', '.join(ROOMS)}")
        out[word] = ROOMS[owner[0]]._replace(files=(word,))
    return out


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("rooms", nargs="*", help=f"rooms ({', '.join(ROOMS)}) or their files")
    parser.add_argument("-n", type=int, default=25, help="mutants of each file; 0: all")
    parser.add_argument("--seed", type=int, default=1, help="root of the sample")
    parser.add_argument("--again", action="store_true", help="try what survived once more")
    parser.add_argument("--score", action="store_true", help="run nothing")
    given = parser.parse_args()
    rooms = chosen(given.rooms)
    if not given.score:
        judge(rooms, given.n, given.seed, given.again)
    score(rooms)


if __name__ == "__main__":
    main()
