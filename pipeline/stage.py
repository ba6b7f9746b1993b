"""What every stage shares: declare knobs, read params.yaml, show progress, fail in one line."""

import _thread
import json
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import field, fields
from difflib import get_close_matches
from math import isfinite
from pathlib import Path
from typing import Any

import psutil
import typer
from tqdm import tqdm

from s3le.errors import ParameterError, S3leError
from s3le.store import yaml
from s3le.store.documents import write_json

PARAMS = Path("params.yaml")
TIMING = Path("reports/timing.json")


def knob(
    doc: str,
    *,
    at_least: float = float("-inf"),
    at_most: float = float("inf"),
    one_of: tuple[str, ...] = (),
    shared: bool = False,
) -> Any:
    """Declare one parameter; a shared one sits at the top of params.yaml, not in a section."""
    about = {"doc": doc, "range": (at_least, at_most), "one_of": one_of, "shared": shared}
    return field(metadata=about)


def dvc_keys(*params: type) -> list[str]:
    """The keys that dvc.yaml must list under `params:` for a stage that reads these classes."""
    keys = []
    for cls in params:
        shared = [f.name for f in fields(cls) if f.metadata["shared"]]
        keys += shared + ([cls.section] if len(shared) < len(fields(cls)) else [])
    return list(dict.fromkeys(keys))


def read(params: type, path: Path = PARAMS, of: str = "") -> Any:
    """Read and check one class of parameters; refuse the first wrong one by name.

    Args:
        params: the class.
        path: the file.
        of: its own are those of this name in its section; empty: the section's.

    Raises:
        ParameterError: params.yaml is missing, too long or not YAML, or a key of this class or
            its section is missing, unknown, of the wrong type or out of its range.
    """
    try:
        tree, _ = yaml.mapping(path, "parameters", ParameterError)
    except FileNotFoundError:
        raise ParameterError(f"{path} is missing here; run from the project's folder") from None
    own = [f.name for f in fields(params) if not f.metadata["shared"]]
    section, name = tree.get(params.section, {}) if own else {}, params.section if own else ""
    if of and isinstance(section, dict):
        section, name = section.get(of, {}), f"{name}.{of}"
    if not isinstance(section, dict):
        raise ParameterError(f"{path}: '{name}' must be a mapping, got {section!r}")
    for key in section.keys() - set(own):
        near = get_close_matches(str(key), own, n=1)
        hint = f"; did you mean {near[0]}?" if near else f"; it has: {', '.join(own)}"
        raise ParameterError(f"{path}: section '{name}' has no parameter '{key}'{hint}")
    values = {}
    for f in fields(params):
        shared = f.metadata["shared"]
        home, where = (tree, f.name) if shared else (section, f"{name}.{f.name}")
        if f.name not in home:
            raise ParameterError(f"{path}: {where} is missing ({f.metadata['doc']})")
        values[f.name] = _checked(path, where, f, home[f.name])
    return params(**values)


def _checked(path: Path, where: str, f: Any, value: Any) -> Any:
    if f.type is float and type(value) is int and abs(value) < 2**63:
        value = float(value)  # `-S alpha=1` writes an int
    if one_of := f.metadata["one_of"]:
        if value not in one_of:
            near = get_close_matches(str(value), one_of, n=1)
            hint = f"; did you mean {near[0]}?" if near else ""
            raise ParameterError(
                f"{path}: {where} must be one of {', '.join(one_of)}, got {value!r}{hint}"
            )
        return value
    low, high = f.metadata["range"]
    inside = type(value) is f.type and (f.type not in (int, float) or low <= value <= high)
    if f.type is int:
        inside = inside and abs(value) < 2**63
    if f.type is float:
        inside = inside and isfinite(value)
    if f.type is str:
        inside = inside and value.isprintable() and 0 < len(value) < 1000
    if not inside:
        span = f" in [{low:g}, {high:g}]" if f.type in (int, float) else ""
        raise ParameterError(f"{path}: {where} must be {f.type.__name__}{span}, got {value!r}")
    return value


@contextmanager
def bar(
    total: int, what: str, unit: str = "rows", wait: str = "kernels compile at first use"
) -> Iterator[Callable[[int], object]]:
    """A progress bar; yields the function to call with numbers of rows done.

    Args:
        total: how many there are.
        what: what is being done.
        unit: what is counted.
        wait: what is said until the first of them is done.
    """
    with _bar(total, what, unit, unit_scale=True) as shown:
        shown.set_postfix_str(wait)

        def advance(rows: int) -> None:
            if shown.n == 0:
                shown.set_postfix_str("", refresh=False)
            shown.update(rows)

        yield advance


@contextmanager
def steps_bar(total: int, what: str) -> Iterator[Callable[[int, int, dict[str, float]], None]]:
    """A progress bar for a training; yields what takes (steps done, of all, loss terms)."""
    with _bar(total, what, "steps", mininterval=1) as shown:

        def on_step(done: int, _: int, terms: dict[str, float]) -> None:
            shown.update(done - shown.n)
            if done % 50 == 0:
                shown.set_postfix({name: f"{value:.3g}" for name, value in terms.items()})

        yield on_step


@contextmanager
def shards_bar(total: int, what: str) -> Iterator[Callable[[int, dict], None]]:
    """A progress bar for the engine; yields what takes (rows done, all counts so far)."""
    with _bar(total, what, "rows", unit_scale=True) as shown:
        shown.set_postfix_str("workers start")

        def advance(rows: int, counts: dict) -> None:
            told = [
                f"{words} {counts[name] / counts['rows']:.2%}"
                for name, words in (("solved", "projected"), ("fallback", "by fallback"))
                if name in counts
            ]
            shown.set_postfix_str(", ".join(told), refresh=False)
            shown.update(rows)

        yield advance


def _bar(total: int, what: str, unit: str, **how: Any) -> tqdm:
    """A bar on a terminal; nothing where nobody looks on."""
    return tqdm(total=total, desc=what, unit=f" {unit}", file=sys.stderr, disable=None, **how)


def say(line: str) -> None:
    """One line for the person who is watching."""
    typer.echo(line)


def launch(main: Callable[..., None], name: str) -> None:
    """Run a stage; a refusal is one line on stderr and exit status 2, not a traceback.

    Args:
        main: the stage; its arguments come from the command line.
        name: the stage's name in dvc.yaml; an argument makes it `name@argument`.
    """
    began = time.perf_counter()
    name = "@".join([name, *sys.argv[1:2]])
    if "DVC_STAGE" in os.environ:
        threading.Thread(target=_end_with_dvc, daemon=True).start()
    app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
    app.command()(main)
    try:
        app(standalone_mode=False)
    except S3leError as refusal:
        typer.echo(f"{type(refusal).__name__}: {refusal}", err=True)
        raise SystemExit(2) from None
    except OSError as refusal:
        typer.echo(f"stage '{name}': {refusal}; nothing was half-written, run it again", err=True)
        raise SystemExit(2) from None
    except (typer.Abort, KeyboardInterrupt):
        raise SystemExit(130) from None
    _note_time(name, time.perf_counter() - began)


def _end_with_dvc() -> None:
    """Stop when the dvc that started this stage is gone: what it would write is no longer wanted.

    dvc that is killed leaves its stages running, and a second dvc may start the same stage.
    """
    above = []
    for process in psutil.Process().parents():
        above.append(process)
        if "dvc" in " ".join(process.cmdline()[:3]):
            break
    else:
        return  # not started by dvc, only with its environment
    while all(process.is_running() for process in above):
        time.sleep(0.3)
    typer.echo("dvc is gone, so this stage stops; run dvc repro to go on", err=True)
    _thread.interrupt_main()  # leaves in order, if the main thread gets to it
    time.sleep(3.0)
    os._exit(130)


def _note_time(name: str, seconds: float) -> None:
    """Add this stage's wall time to reports/timing.json; times are no part of any result."""
    try:
        times = json.loads(TIMING.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        times = {}  # the first stage of a fresh checkout, or a file cut short: start it anew
    times = times if isinstance(times, dict) else {}
    times[name] = {"seconds": round(seconds, 2), "processors": len(os.sched_getaffinity(0))}
    with suppress(OSError):  # the results are there
        write_json(times, TIMING)
