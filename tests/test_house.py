"""The house rules: who may import whom, and does dvc.yaml tell the truth."""

import ast
from dataclasses import fields
from importlib import import_module
from pathlib import Path

import pytest
from ruamel.yaml import YAML

from pipeline.index import PLACE
from pipeline.stage import dvc_keys
from pipeline.train import METHODS
from s3le.learn.methods import ENTRIES
from s3le.tuples.engine.key import closure, file_of, imported

ROOT = Path(__file__).parents[1]
STAGES = YAML(typ="safe").load(ROOT / "dvc.yaml")["stages"]
PARAMS = YAML(typ="safe").load(ROOT / "params.yaml")


def switched_on(**more: object) -> dict:
    """Section dataset of params.yaml as it is with the # taken away, and `mine` changed."""
    text = (ROOT / "params.yaml").read_text(encoding="utf-8")
    tree = YAML(typ="safe").load(
        text.split("dataset: {}")[1].split("\n", 1)[1].replace("#  ", "  ")
    )
    return tree | {"mine": tree["mine"] | more}


STAGES["dataset"]["foreach"] = switched_on()
FILES = sorted((ROOT / "s3le").rglob("*.py"))
ROBOTS = "s3le/robots"  # those that come with the package: data
STAGE_MAY_IMPORT = {"collections", "dataclasses", "math", "pathlib", "typing", "s3le", "pipeline"}
ROOM_OF = {  # a heavy dependency lives in one room
    "pinocchio": ("s3le/robot/", "s3le/onboard/", "s3le/safety/judge.py", "s3le/show/visual.py"),
    "coal": ("s3le/robot/", "s3le/onboard/", "s3le/show/visual.py"),
    "scipy": ("s3le/onboard/",),
    "numba": ("s3le/kernels/", "s3le/safety/", "s3le/search/", "s3le/retarget/", "s3le/plan/"),
    "h5py": ("s3le/guard/layouts/hdf5.py",),
    "pooch": ("s3le/human/fetch.py",),
    "requests": ("s3le/human/fetch.py",),
    "torch": (
        *(
            f"s3le/learn/{file}.py"
            for file in ("models", "losses", "batches", "training", "artifact")
        ),
        "s3le/study/synthetic.py",
    ),
    "safetensors": ("s3le/learn/artifact.py", "s3le/retarget/encoder.py"),
    "polars": (
        "s3le/store/",
        "s3le/guard/table.py",
        "s3le/human/tables.py",
        "s3le/learn/table.py",
        "s3le/retarget/clips.py",
        "s3le/retarget/table.py",
        "s3le/robot/table.py",
        "s3le/study/tables.py",
        "s3le/tuples/tables.py",
    ),
    "pyarrow": (
        "s3le/store/tables.py",
        "s3le/motion/parquet.py",
        "s3le/guard/layouts/parquet.py",
        "s3le/guard/layouts/lerobot.py",
        "s3le/guard/layouts/lerobot_new.py",
        "s3le/human/points_parquet.py",
    ),
    "matplotlib": ("s3le/report/", "s3le/show/"),
    "anyascii": ("s3le/report/", "s3le/show/"),
    "viser": ("s3le/show/viewer/",),
    "trimesh": ("s3le/show/viewer/",),
    "av": ("s3le/show/movie.py", "s3le/video/decode.py"),
    "mediapipe": ("s3le/video/worker.py",),
    "jinja2": ("s3le/report/document.py",),
    "markupsafe": ("s3le/report/embed.py",),
    "PIL": ("s3le/show/movie.py", "s3le/report/embed.py"),
    "ruamel": ("s3le/store/yaml.py",),
    "ray": ("s3le/tuples/engine/cluster.py",),
    "typer": ("s3le/cli/",),
    "tqdm": ("s3le/cli/",),
}
# What each room must not reach, even through others: the arrows of the house.
APART = [
    ("s3le/cli/", {"torch", "dvc", "psutil"}),
    ("s3le/robot/", {"torch", "numba", "matplotlib", "scipy"}),
    ("s3le/onboard/", {"torch", "matplotlib"}),
    ("s3le/kernels/", {"torch", "matplotlib"}),
    ("s3le/safety/", {"torch", "matplotlib"}),
    ("s3le/search/", {"torch", "matplotlib"}),
    ("s3le/plan/", {"torch", "matplotlib", "ray"}),
    ("s3le/guard/", {"torch", "matplotlib"}),
    ("s3le/human/", {"torch", "numba", "pinocchio", "coal", "matplotlib"}),
    ("s3le/report/", {"torch", "pinocchio", "coal"}),
    ("s3le/tuples/", {"torch", "matplotlib"}),
    ("s3le/tuples/engine/", {"torch", "pinocchio", "coal", "matplotlib"}),
    ("s3le/retarget/", {"torch", "matplotlib", "ray"}),
    ("s3le/learn/training.py", {"numba", "pinocchio", "coal", "polars", "matplotlib"}),
    ("s3le/motion/", {"torch", "matplotlib"}),
    ("s3le/guard/layouts/", {"torch", "numba", "matplotlib", "ray"}),
    ("s3le/inert/", {"torch", "numba", "pinocchio", "coal", "matplotlib", "polars", "pyarrow"}),
    ("s3le/show/", {"torch"}),
    ("s3le/show/viewer/", {"torch", "ray", "av"}),
    ("s3le/video/", {"torch", "numba", "pinocchio", "coal", "matplotlib", "viser"}),
    ("s3le/store/", {"torch", "numba", "pinocchio", "coal", "matplotlib"}),
]


def module_of(stage: str) -> str:
    return f"pipeline.{stage}"


def body_of(stage: str) -> dict:
    entry = STAGES[stage]
    return entry.get("do", entry)


def listed(stage: str, what: str) -> list[str]:
    """Paths or keys of a stage as seen from the project's folder."""
    body = body_of(stage)
    found = []
    for item in body.get(what, []):
        if isinstance(item, dict) and what == "params":
            found += [key for keys in item.values() for key in keys]
        else:
            found.append(next(iter(item)) if isinstance(item, dict) else item)
    wdir = body.get("wdir")
    if not wdir or what == "params":
        return found
    return [str((ROOT / wdir / path).resolve().relative_to(ROOT)) for path in found]


def code_of(stage: str) -> list[str]:
    """The code that a stage runs: a room of which it reaches half or more, else single files."""
    runs = {path.relative_to(ROOT) for path in closure(module_of(stage))}
    runs -= {Path("s3le/__init__.py"), Path("pipeline/__init__.py")}  # nothing in them runs
    found = {path for path in runs if len(path.parts) <= 2}
    found |= {room for path in runs if len(path.parts) == 3 for room in [path.parent]
              if 2 * len(runs & _of(room)) >= len(_of(room))}  # fmt: skip
    deep = {path.parent for path in runs if len(path.parts) > 3}
    found |= {room for room in deep if 2 * len(runs & _of(room)) >= len(_of(room))}
    found |= {path for path in runs if not found & set(path.parents)}
    return sorted(path.as_posix() for path in found if not found & set(path.parents))


def _of(room: Path) -> set[Path]:
    return {path.relative_to(ROOT) for path in (ROOT / room).rglob("*.py")}


@pytest.mark.parametrize("stage", STAGES)
def test_dvc_yaml_lists_the_code_that_a_stage_runs_and_no_room_of_which_it_uses_less_than_half(
    stage,
):
    code = [d for d in listed(stage, "deps") if d.startswith(("s3le", "pipeline"))]
    assert [path for path in code if path != ROBOTS] == code_of(stage)
    assert (ROBOTS in code) == (stage in ("robot", "dataset"))


def test_an_edit_of_a_template_writes_the_page_anew():
    found = [path.relative_to(ROOT) for path in (ROOT / "s3le").rglob("*.j2")]
    assert found and all("s3le/report" in map(str, path.parents) for path in found)
    assert "s3le/report" in listed("report", "deps")


@pytest.mark.parametrize("stage", sorted(STAGES.keys() - {"train"}))
def test_dvc_yaml_lists_exactly_the_parameters_that_a_stage_reads(stage):
    params = import_module(module_of(stage)).Params
    assert params.section == stage
    listed_keys = [key.replace(".${key}", "") for key in listed(stage, "params")]
    assert listed_keys == dvc_keys(params)


@pytest.mark.parametrize("method", METHODS)
def test_each_training_lists_exactly_the_parameters_that_it_reads(method):
    item = STAGES["train"]["foreach"][method]
    keys = [
        key.replace("${key}", method).replace("${item.tau}", item["tau"])
        for key in listed("train", "params")
    ]
    params = import_module("pipeline.train").Params
    assert sorted(set(keys)) == sorted(dvc_keys(params, METHODS[method]))


def test_params_yaml_holds_every_key_once_and_no_other():
    known = {}
    for stage in STAGES:
        module = import_module(module_of(stage))
        for cls in [module.Params, *(METHODS.values() if stage == "train" else [])]:
            for f in fields(cls):
                if f.metadata["shared"]:
                    known[f.name] = None
                else:
                    known.setdefault(cls.section, set()).add(f.name)
    given = PARAMS | {"dataset": switched_on()["mine"]}
    assert PARAMS["dataset"] == {}  # off
    assert {k: set(v) if isinstance(v, dict) else None for k, v in given.items()} == known


def test_every_key_of_params_yaml_has_a_sentence():
    for line in (ROOT / "params.yaml").read_text(encoding="utf-8").splitlines():
        if line and not line.startswith("#") and ":" in line and not line.rstrip().endswith(":"):
            assert "#" in line, f"params.yaml: no sentence beside {line.strip()!r}"


@pytest.mark.parametrize("stage", STAGES)
def test_a_stage_only_moves_data(stage):
    roots = {name.split(".")[0] for name in imported(file_of(module_of(stage)))}
    assert roots <= STAGE_MAY_IMPORT


@pytest.mark.parametrize("stage", STAGES)
def test_a_stage_says_what_it_is_for(stage):
    assert body_of(stage)["desc"]


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(ROOT)))
def test_heavy_dependencies_keep_to_their_room(path):
    here = path.relative_to(ROOT).as_posix()
    names = {name.split(".")[0] for name in imported(path)}
    for name in names & ROOM_OF.keys():
        assert here.startswith(ROOM_OF[name]), f"{here} imports {name}"
    assert not names & {"pipeline", "dvc", "psutil"}, f"{here} imports a tool of the stages"


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(ROOT)))
def test_rooms_that_are_apart_do_not_reach_each_other(path):
    here = path.relative_to(ROOT).as_posix()
    module = here.removesuffix(".py").removesuffix("/__init__").replace("/", ".")
    for room, foreign in APART:
        # kernels build their arrays from a robot, which pinocchio reads: that arrow is wanted.
        if here.startswith(room):
            reached = {name.split(".")[0] for file in closure(module) for name in imported(file)}
            assert not reached & foreign, f"{here} reaches {sorted(reached & foreign)}"


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(ROOT)))
def test_files_can_be_read_in_one_sitting(path):
    assert len(path.read_text(encoding="utf-8").splitlines()) <= 450


@pytest.mark.parametrize("path", sorted(p for p in FILES if p.name == "__init__.py"), ids=str)
def test_front_doors_are_empty(path):
    public = {  # what people import from a room, and what hands it out lazily
        "retarget": {"Retargeter"},
        "guard": {"import_module"},
        "s3le": {"os", "import_module"},
    }
    named = [
        alias.name
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, (ast.Import, ast.ImportFrom))
        for alias in node.names
    ]
    assert set(named) <= public.get(path.parent.name, set())


def test_the_entries_in_dvc_yaml_store_and_load_what_the_code_does():
    index, evaluate = STAGES["index"]["foreach"], STAGES["evaluate"]["foreach"]
    assert set(evaluate) == set(ENTRIES)
    assert set(index) == {name for name, entry in ENTRIES.items() if entry.pool}
    for name, entry in ENTRIES.items():
        model = f"data/model-{entry.model}.safetensors"
        if entry.pool:
            given = set(index[name].values()) | {"data/mocap_pairs.parquet"}
            needed = {f"data/{PLACE[table]}" for table in entry.pool}
            assert given == needed | ({model} if entry.model else set())
        needed = {f"data/index-{name}.parquet"} if entry.pool else set()
        if entry.online:
            needed = {"data/retargeter"}
        assert set(evaluate[name].values()) == needed | ({model} if entry.model else set())


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(ROOT)))
def test_imports_are_absolute(path):
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom):
            assert node.level == 0, "write the import absolutely"


def test_every_stage_and_its_outputs_are_in_the_table_of_parameters():
    text = (ROOT / "docs" / "parameters.md").read_text(encoding="utf-8")
    for key, value in PARAMS.items():
        for name in [f"{key}.{own}" for own in value] if isinstance(value, dict) else [key]:
            assert f"`{name}`" in text, f"docs/parameters.md does not mention {name}"
