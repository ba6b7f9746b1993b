"""Who runs, with which settings, and who does not and why."""

import json
from pathlib import Path
from typing import Any, NamedTuple

HERE = Path(__file__).resolve().parent
CHOSEN = HERE / "chosen.json"  # what sweep.py found best
OURS = ("file", "stream")


class Entrant(NamedTuple):
    """One way of retargeting."""

    key: str
    label: str
    module: str  # in solvers/; "ours": in this project's environment
    packages: tuple[str, ...]  # whose installed size is told, with all that they need
    readme: dict[str, Any]  # protocol two: as its own documentation has it
    readme_says: str  # in words
    sweep: dict[str, tuple]  # settings that sweep.py tries, each with each
    protocols: tuple[int, ...] = (1, 2)
    most: int = 0  # frames of a clip that it gets; 0: all that there are
    robots: tuple[str, ...] = ()  # it can do; (): any
    kinds: tuple[str, ...] = ()  # of tasks that it gets; (): any
    environment: str = "field"  # heading in requirements-rivals.lock
    clone: tuple[str, ...] = ()  # folders of a user's own clones it runs from; (): from PyPI
    accelerations: bool = False  # it can be asked for limits of them
    compiles: bool = False  # before its first motion, once on a machine, for minutes


ENTRANTS = (
    Entrant(
        "file", "s3le, file", "ours", ("s3le",), {}, "s3le retarget CLIP", {},
    ),
    Entrant(
        "stream", "s3le, stream", "ours", ("s3le",), {}, "Retargeter.start().step(x, dt)", {},
    ),
    Entrant(
        "mink", "mink", "by_mink", ("mink", "daqp"),
        {"solves": 1, "collisions": False, "speed": False, "posture": 1e-2},
        "frame tasks and a posture task, joint limits, one program a frame; collision and speed "
        "limits are opt-in",
        {"solves": (1, 4, 10), "gain": (0.5, 0.85), "detected": (0.05, 0.2)},
    ),
    Entrant(
        "pink", "pink", "by_pink", ("pin-pink", "daqp"),
        {"solves": 1, "closest": 0, "posture": 1e-3, "damping": 0.0},
        "frame tasks and a posture task, joint and speed limits, one program a frame; the "
        "self-collision barrier is opt-in",
        {"solves": (1, 4), "gain": (5.0, 20.0), "closest": (10, 20)}, accelerations=True,
    ),
    Entrant(
        "embodik", "EmbodiK", "by_embodik", ("embodik",),
        {"steps": 1, "rows": 1, "margin": 0.05, "share": 0.0333, "tuning": "BALANCED"},
        "position steps of gain 1 per second, joint and speed limits, one collision row at 50 mm",
        {"steps": (1, 4, 10), "share": (0.5, 1.0), "rows": (5, 10)}, accelerations=True,
    ),
    Entrant(
        "placo", "placo", "by_placo", ("placo",),
        {"solves": 1, "collisions": "", "regularization": 1e-6},
        "position tasks and a regularization task, joint and speed limits, one program a frame; "
        "self-collisions are opt-in",
        {"solves": (1, 4), "collisions": ("hard", "soft"), "trigger": (0.02, 0.05)},
    ),
    Entrant(
        "roboplan", "roboplan (OInK)", "by_roboplan", ("roboplan",),
        {"solves": 1, "closest": 0, "damping": 0.0},
        "frame tasks, joint and speed limits, one program a frame; barriers are opt-in",
        {"solves": (1, 4), "closest": (0, 1, 20), "gain": (1.0, 5.0)},
        environment="roboplan", accelerations=True,
    ),
    Entrant(
        "xr_teleoperate", "xr_teleoperate, rebuilt", "by_wrists", ("casadi",), {"clip": 20.0},
        "two wrist poses by IPOPT with its published weights; arms alone, no collisions", {},
        protocols=(2,),
    ),
    Entrant(
        "decoupled_wbc", "decoupled_wbc, rebuilt", "by_hands", ("pin-pink", "daqp"), {},
        "two hand poses by pink with its published weights; its collision check is commented out",
        {}, protocols=(2,),
    ),
    Entrant(
        "holosoma", "holosoma-retargeting", "by_holosoma", ("holosoma-retargeting", "mujoco"), {},
        "robot_only, its own G1, self-collision off as it ships; 20 frames of CMU's clips",
        {}, protocols=(2,), most=20, robots=("g1",), kinds=("cmu", "own"), environment="holosoma",
    ),
    Entrant(
        "sew", "SEW-Mimic (chase6305)", "by_sew", (), {"backend": "python"},
        "closed-form arms, its Python backend; arms alone, no speed limits, its safety filter off",
        {}, protocols=(2,), clone=("SEW-mimic-retargeting/src",),
    ),
    Entrant(
        "pyroki", "PyRoki", "by_pyroki", ("jax", "jaxlie", "jax_dataclasses"), {"rest": 0.1},
        "its example for many targets, on a processor; no speed limits, collisions off",
        {}, protocols=(2,), environment="jax", clone=("pyroki/src", "jaxls/src"),
    ),
    Entrant(
        "gmr", "GMR", "by_gmr", ("mink", "mujoco", "daqp", "scipy"), {},
        "smplx to unitree_g1, its own G1 and tables, of a person who stands; joint limits, no "
        "speed limits, no collisions", {}, protocols=(2,), robots=("g1",), clone=("GMR",),
    ),
    Entrant(
        "soma", "soma-retargeter (eden)", "by_soma", ("eden-soma-retargeter",), {},
        "its own G1 and tables, of a person who stands, on a processor; no speed limits, no "
        "collisions; 30 frames of each clip, and the 15 that it puts before them count", {},
        protocols=(2,), most=30, robots=("g1",), kinds=("cmu", "deepmimic", "lafan", "own"),
        environment="soma", clone=("newton-assets",), compiles=True,
    ),
)  # fmt: skip

# Named, not run.
NOT_RUN = {
    "cuRobo": "needs CUDA",
    "hhtools (Roboparty)": "its retargeting needs CUDA 12",
    "HoloRetarget (HoloMotion)": "needs CUDA",
    "mink-warp": "needs a GPU",
    "UMR": "its learnt surface correspondence wants a GPU",
    "WARP, NMR, ConstrainedMimic, BarrierIK": "no code is published",
}


def by_key(keys: str) -> list[Entrant]:
    """The entrants of a list of keys, or all of them.

    Raises:
        SystemExit: one is unknown.
    """
    if keys == "all":
        return list(ENTRANTS)
    known = {one.key: one for one in ENTRANTS}
    for key in keys.split(","):
        if key not in known:
            raise SystemExit(f"no entrant is called {key!r}; known are {', '.join(known)}")
    return [known[key] for key in keys.split(",")]


def accelerations() -> dict[str, Any]:
    """Label -> robot -> what sweep.py saw without and with limits of accelerations."""
    known = json.loads(CHOSEN.read_text(encoding="utf-8")).get("accelerations", {})
    return {one.label: known[one.key] for one in ENTRANTS if one.key in known}


def settings(entrant: Entrant, protocol: int, robot: str) -> dict[str, Any]:
    """With what an entrant runs: protocol 1 what the sweep chose, 2 what its documentation has.

    Raises:
        SystemExit: there is no choice recorded for it.
    """
    if protocol == 2 or entrant.module == "ours":
        return dict(entrant.readme) if protocol == 2 else {}
    chosen = json.loads(CHOSEN.read_text(encoding="utf-8"))["chosen"]
    if entrant.key not in chosen:
        raise SystemExit(f"{CHOSEN} has no settings for {entrant.key}; run sweep.py")
    return dict(chosen[entrant.key].get(robot) or chosen[entrant.key]["any"])
