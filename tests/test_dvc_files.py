"""dvc.yaml against the files that the stages' own code names: none is read or written in secret.

Paths are read off the syntax tree of a stage: constants, joined by `/`, words filled in stand for
anything.
"""

import ast
from fnmatch import fnmatchcase

import pytest
from test_house import ROOT, STAGES, body_of, listed, module_of

from s3le.tuples.engine.key import file_of

# Neither input nor result: how far a stage has come, or what was fetched.
SCRATCH = {"data/checkpoints/*.safetensors", "data/downloads"}
# Records that are made beside the pipeline, and shown where there are any.
RECORDS = {"reports/latency.json", "reports/video/figure.json", "reports/video/figure.png"}
# Read through what names it: a robot's own file says where its URDF is, params.yaml a folder.
INDIRECT = {"data/robots", "data/clips/own"}
# What comes from outside: robots, and what is committed.
SOURCES = ("data/robots", "data/clips", "reports/latency.json", "reports/video")


def text_of(node, known):
    """A path as a pattern, or None where the expression is no path."""
    if isinstance(node, ast.Name):
        return known.get(node.id)
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return node.value
    if isinstance(node, ast.JoinedStr):
        return "".join(
            part.value if isinstance(part, ast.Constant) else "*" for part in node.values
        )
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Div):
        folder = text_of(node.left, known)
        below = text_of(node.right, known) or "*"
        return folder and f"{folder}/{below}"
    if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "Path" and node.args:
        return text_of(node.args[0], known)
    return None


def named(stage):
    """Patterns of the files that a stage's module names in its functions."""
    tree = ast.parse(file_of(module_of(stage)).read_text(encoding="utf-8"))
    known = {}
    for node in tree.body:
        if isinstance(node, ast.Assign) and isinstance(node.value, (ast.Call, ast.BinOp)):
            if text := text_of(node.value, known):
                known[node.targets[0].id] = text
    found = set()

    def walk(node):
        if isinstance(node, (ast.BinOp, ast.Name)) and (text := text_of(node, known)):
            found.add(text)
            return  # its parts are folders
        for child in ast.iter_child_nodes(node):
            walk(child)

    for node in tree.body:
        if isinstance(node, ast.FunctionDef):
            walk(node)
    return found


def data(stage, what):
    """Paths under deps or outs that hold data, written out for each item of a stage."""
    entry = STAGES[stage]
    items = entry.get("foreach", {"": {}})
    paths = set()
    for key, item in items.items():
        for path in listed(stage, what):
            path = path.replace("${key}", key).replace("${robot}", "*").replace("${clips}", "*")
            for name, value in (item or {}).items():
                path = path.replace(f"${{item.{name}}}", str(value))
            paths.add(path)
    return {path for path in paths if path.startswith(("data/", "reports/"))}


def made_by(stage):
    """Everything that a stage writes."""
    return data(stage, "outs") | data(stage, "metrics") | data(stage, "plots")


def within(path, pattern):
    """Is the path what the pattern names, or a folder that it lies in, or the reverse?"""
    return (
        fnmatchcase(path, pattern)
        or fnmatchcase(pattern, path)
        or (fnmatchcase(pattern, f"{path}/*") or fnmatchcase(path, f"{pattern}/*"))
    )


@pytest.mark.parametrize("stage", STAGES)
def test_every_file_that_a_stage_names_is_in_dvc_yaml(stage):
    told = data(stage, "deps") | made_by(stage)
    secret = {
        pattern for pattern in named(stage) - SCRATCH
        if not any(within(path, pattern) for path in told)
    } - RECORDS  # fmt: skip
    assert not secret, f"stage '{stage}' uses {sorted(secret)}; add to its deps or outs"


@pytest.mark.parametrize("stage", STAGES)
def test_dvc_yaml_names_no_file_that_a_stage_does_not(stage):
    idle = {
        path
        for path in data(stage, "deps") | made_by(stage)
        if not any(within(path, pattern) for pattern in named(stage))
    } - INDIRECT
    assert not idle, f"stage '{stage}' does not use {sorted(idle)}"


def test_every_file_that_is_read_is_made_by_one_stage_before():
    made = {}
    for stage in STAGES:
        for path in made_by(stage):
            assert path not in made, f"{path} is made by '{stage}' and '{made[path]}'"
            made[path] = stage
    for stage in STAGES:
        for path in data(stage, "deps"):
            if path.startswith(SOURCES):
                continue
            makers = {m for out, m in made.items() if path == out or path.startswith(f"{out}/")}
            assert makers, f"'{stage}' reads {path}, which no stage makes"
            assert makers != {stage}, f"'{stage}' reads {path}, which it makes itself"


def test_the_reader_of_paths_sees_them_in_every_form():
    assert named("train") >= {
        "data/robot", "data/mocap_domain.parquet", "data/mocap_pairs.parquet", "data/robot_poses",
        "data/kinematic_pairs", "data/model-*.safetensors", "reports/training/*.csv",
    }  # fmt: skip
    assert {"data/skeletons.parquet", "data/mocap_domain.parquet"} <= named("skeletons")
    assert body_of("train")["outs"][0] == "data/model-${key}.safetensors"
    assert (ROOT / "dvc.yaml").is_file()
